"""A picture of how the source lies over the target."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.transfer.pair import Mesh


def draw_registration(
    path: str,
    source: Mesh,
    target: Mesh,
    pairs: NDArray[np.int32],
    registered: NDArray[np.float64] | None,
    *,
    up: NDArray[np.float64],
) -> None:
    """Draw the registered source, the target with its unmatched triangles, and both together.

    Without a registration (V, 3) the source's rest is laid over the target by the triangle pairs
    (K, 2). Raises ImportError where nothing can be drawn.
    """
    from dtrepair.display.render import make_view, render, save_pictures
    from dtrepair.transfer.rests import laid_over

    placed = laid_over(source, target, pairs) if registered is None else registered
    unmatched = np.ones(len(target[1]), dtype=bool)
    unmatched[pairs[:, 1]] = False
    view = make_view([placed, target[0]], up=up)
    together = np.concatenate([target[0], placed])
    faces = np.concatenate([target[1], source[1] + len(target[0])]).astype(np.int32)
    red = np.arange(len(faces)) >= len(target[1])
    images = [
        render(placed, source[1], view=view),
        render(target[0], target[1], view=view, intersecting=unmatched),
        render(together, faces, view=view, intersecting=red),
    ]
    captions = [
        "source, laid over" if registered is None else "source, registered",
        f"target: {int(unmatched.sum())} unmatched triangles",
        "both: source in red",
    ]
    save_pictures(path, images, captions=captions)
