"""Parts that a pose has wholly inside others, and the rest has not, are led out.

Nothing intersects there, so contacts cannot drive them; a shift along the shortest way does, and
the repair of the contacts takes over where it ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import eased_in_time
from dtrepair.repair.scene.scene import Scene


@dataclass(frozen=True, kw_only=True)
class ReleaseOptions:
    """How enclosed parts are led out.

    Args:
        beyond: Factor by which a shift is longer than the way to the surface: out is out.
        width: Standard deviation, in frames, over which a shift comes and goes.
    """

    beyond: float = 1.02
    width: float = 2.0


def released(
    scene: Scene,
    points: FloatArray,
    parts: IntArray,
    *,
    options: ReleaseOptions = ReleaseOptions(),
) -> FloatArray:
    """Return the pose (V, 3) with the inner part of each (inner, outer) (K, 2) shifted out.

    A part that cannot move stays.
    """
    frames = released_frames(scene, points[None], [parts], np.zeros(1), options=options)
    pose: FloatArray = frames[0]
    return pose


def released_frames(
    scene: Scene,
    poses: FloatArray,
    parts: Sequence[IntArray],
    frames: FloatArray,
    *,
    options: ReleaseOptions = ReleaseOptions(),
) -> FloatArray:
    """Return poses (T, V, 3) at `frames` (T,) with what each of them encloses shifted out.

    All frames of a part leave along one way, that of the middle one, as far as each needs; before
    and after, the shift comes and goes smoothly. What another part carries comes out with that, and
    so does a link of a chain of attached parts of which some are outside.
    """
    result = poses.copy()
    met: dict[tuple[int, int], list[int]] = {}
    for frame, found in enumerate(parts):
        for inner, outer in found.tolist():
            met.setdefault((inner, outer), []).append(frame)
    enclosures, carried, mates = scene.enclosures, _carried(scene), _mates(scene)
    for (inner, outer), where in met.items():
        inside = {first for first, second in met if second == outer}
        held = inner in carried or not _chain(mates, inner, outer) <= inside
        moved = None if held else _movable(scene, inner)
        if moved is None:
            continue
        way = enclosures.way_out(poses[where[len(where) // 2]], inner, outer)
        length = float(np.linalg.norm(way))
        if length == 0.0:
            continue
        way /= length
        needed = np.zeros(len(frames))
        for frame in where:
            far = enclosures.length_along(poses[frame], way, inner, outer)
            needed[frame] = options.beyond * far
        result[:, moved] += eased_in_time(needed, frames, options.width)[:, None, None] * way
    return result


def _carried(scene: Scene) -> set[int]:
    """Return the parts that ride on others."""
    if scene.attachments is None:
        return set()
    return set(scene.enclosures.part[scene.attachments.carried.vertices].tolist())


def _mates(scene: Scene) -> dict[int, set[int]]:
    """Return the parts that each part is attached to."""
    mates: dict[int, set[int]] = {}
    for first, second in scene.attached_parts.pairs:
        mates.setdefault(first, set()).add(second)
        mates.setdefault(second, set()).add(first)
    return mates


def _chain(mates: dict[int, set[int]], part: int, outer: int) -> set[int]:
    """Return the parts that hang together with a part, but by another one."""
    chain, ends = {part}, [part]
    for end in ends:
        new = mates.get(end, set()) - chain - {outer}
        chain |= new
        ends += sorted(new)
    return chain


def _movable(scene: Scene, part: int) -> NDArray[np.integer] | None:
    """Return the vertices that move along with a part: all of a rigid body; None if it is held."""
    vertices = scene.enclosures.vertices(part)
    body = int(scene.body_of_vertex[vertices[0]])
    if scene.bodies[body].rigid:
        vertices = np.flatnonzero(scene.body_of_vertex == body)
    else:
        # Duplicates along seams move along.
        vertices = np.flatnonzero(np.isin(scene.rest_weld, vertices))
    return vertices if (scene.mobility[vertices] > 0.0).all() else None
