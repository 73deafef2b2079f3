"""Parts that a pose has wholly inside others, and the rest has not: led out before they are pushed.

Nothing intersects there, so contacts cannot drive them; a shift along the shortest way does, and
the repair of the contacts takes over where it ends.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.scene.scene import Scene

# The shift goes this part farther than to the surface.
BEYOND = 1.02
# Standard deviation in frames over which a shift comes and goes.
WIDTH = 2.0


def released(scene: Scene, points: FloatArray, parts: IntArray) -> FloatArray:
    """The pose (V, 3) with every inner part of (inner, outer) (K, 2) shifted out of its outer one.

    A part that cannot move stays.
    """
    pose: FloatArray = released_frames(scene, points[None], [parts], np.zeros(1))[0]
    return pose


def released_frames(
    scene: Scene,
    poses: FloatArray,
    parts: Sequence[IntArray],
    frames: FloatArray,
) -> FloatArray:
    """Poses (T, V, 3) at `frames` (T,) with what each of them encloses shifted out, steadily.

    All frames of a part leave along one way, that of the middle one, as far as each needs; before
    and after, the shift comes and goes smoothly.
    """
    result = poses.copy()
    met: dict[tuple[int, int], list[int]] = {}
    for frame, found in enumerate(parts):
        for inner, outer in found.tolist():
            met.setdefault((inner, outer), []).append(frame)
    for (inner, outer), caught in met.items():
        moved = _movable(scene, inner)
        if moved is None:
            continue
        enclosures = scene.enclosures
        way = enclosures.way_out(poses[caught[len(caught) // 2]], inner, outer)
        length = float(np.linalg.norm(way))
        if length == 0.0:
            continue
        way /= length
        needed = np.zeros(len(frames))
        for frame in caught:
            needed[frame] = BEYOND * enclosures.length_along(poses[frame], way, inner, outer)
        result[:, moved] += eased_in_time(needed, frames, WIDTH)[:, None, None] * way
    return result


def _movable(scene: Scene, part: int) -> NDArray[np.integer] | None:
    """The vertices that move along with a part: all of its body if that is rigid; None: held."""
    vertices = scene.enclosures.vertices(part)
    body = int(scene.body_of_vertex[vertices[0]])
    if scene.bodies[body].rigid:
        vertices = np.flatnonzero(scene.body_of_vertex == body)
    else:
        # Duplicates along seams move along.
        vertices = np.flatnonzero(np.isin(scene.rest_weld, vertices))
    return vertices if (scene.mobility[vertices] > 0.0).all() else None
