"""What of a stage is the set around: it stands still, is large, or furniture beside a body."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.enclosure import facing_away
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.scale import gaps_between, longest_sides, merged_boxes, sets_among
from dtrepair.pipeline.selection import ObjectSettings
from dtrepair.pipeline.stages.rest import posed_once
from dtrepair.pipeline.stages.shot.furniture import FurnitureOptions, furniture
from dtrepair.pipeline.stages.sources import (
    Points,
    Source,
    SourceMesh,
    StageSource,
    few_times,
    usable_times,
)

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class SetOptions:
    """What is taken for the set around.

    Args:
        larger: What stands still is of the set if it is so many times as large as all that moves.
        flat_larger: If it is flat, as a floor or a wall, so many times.
        flat: What is flat is at most so thick, next to its width.
        near: Which way a set faces is seen from what is nearer to it than so many times its own
            size, if anything is.
        furniture: What is taken for furniture.
        views: From so many places at most.
        looks: Frames of the whole clip in which meshes may be beside each other, at most.
    """

    larger: float = 2.0
    flat_larger: float = 1.25
    flat: float = 0.1
    near: float = 1.0
    furniture: FurnitureOptions = field(default_factory=FurnitureOptions)
    views: int = 24
    looks: int = 33


def find_sets(
    source: Source, each: Sequence[ObjectSettings], *, options: SetOptions = SetOptions()
) -> None:
    """Take meshes of the set around for colliders; a character that stands still is none.

    By what is seen at three times of the whole clip. each: the settings of each mesh; what stands
    still and has a mobility of its own is none, and measures nothing.
    """
    if not isinstance(source, StageSource) or len(source.meshes) < 2:
        return
    meshes = source.meshes
    moving = np.array([own.animated or bool(own.handle.skinned) for own in meshes])
    if not (moves := bool(moving.any())):  # a single pose
        moving = np.array([posed_once(own) for own in meshes])
    instanced = np.array([own.handle.instanced for own in meshes])
    colliders = np.array([own.collider for own in meshes]) & ~instanced
    still = colliders | ~moving
    asked = ~still | [own.mobility is None for own in each]
    if not still[asked].any() or still[asked].all():
        return
    sets = _sets(source, still, asked, options)
    if moves:
        sets |= asked & ~colliders & furniture(source, still, sets, options=options.furniture)
    if not sets.any():
        return
    views = _views(source, ~still)
    source.meshes = tuple(
        replace(
            mesh,
            collider=True,
            of_set=not mesh.collider,
            faces_away=_faces_away(source, mesh, views, options),
        )
        if own
        else mesh
        for mesh, own in zip(meshes, sets.tolist(), strict=True)
    )


def pairs_of_sets(source: Source) -> set[tuple[int, int]]:
    """Pairs of meshes (i, j), i <= j, of the set around: what stands still is not repaired."""
    sets = [index for index, mesh in enumerate(source.meshes) if mesh.of_set]
    return {(i, j) for i in sets for j in sets if i <= j}


def pairs_beside(
    source: Source,
    pairs: Sequence[tuple[int, int]],
    *,
    options: SetOptions = SetOptions(),
) -> list[tuple[int, int]]:
    """Return which pairs of meshes are beside each other in some frames of the whole clip.

    What moves is beside no set: it stands on it.
    """
    if not isinstance(source, StageSource):
        return list(pairs)
    pairs = [own for own in pairs if not any(source.meshes[k].faces_away is not None for k in own)]
    if not pairs:
        return []
    count = min(options.looks, len(source.clip_times))
    times = source.clip_times[np.linspace(0, len(source.clip_times) - 1, count).astype(int)]
    asked = np.zeros(len(source.meshes), dtype=bool)
    asked[np.ravel(pairs)] = True
    beside: set[tuple[int, int]] = set()
    for boxes in _boxes(source, asked, usable_times(source, times)):
        gaps = gaps_between(boxes)
        beside |= {own for own in pairs if gaps[own] <= 0.0}
        if len(beside) == len(pairs):
            break
    return [own for own in pairs if own in beside]


def _sets(
    source: StageSource, still: BoolArray, asked: BoolArray, options: SetOptions
) -> BoolArray:
    """Return which meshes (M,) are of the set, of those that are asked (M,) and still (M,)."""
    times = few_times(source)
    flat = np.array(
        [
            own and _is_flat(source, mesh, times[0], options)
            for mesh, own in zip(source.meshes, still.tolist(), strict=True)
        ]
    )
    # The rests tell at once of most stages that nothing is.
    at_rest = _boxes(source, np.zeros_like(still), times[:1])
    sets, seen = still & asked, False
    for boxes in chain(at_rest, _boxes(source, ~still, times)):
        known = boxes[asked], still[asked]
        large = sets_among(*known, options.larger)
        sets[asked] &= large | (flat[asked] & sets_among(*known, options.flat_larger))
        seen = True
        if not sets.any():
            break
    return sets & seen


def _is_flat(source: StageSource, mesh: SourceMesh, time: float, options: SetOptions) -> bool:
    """Return whether a mesh lies about one plane in the world, however that is turned."""
    from usd_io import FrameError

    with suppress(FrameError):
        points = source.to_world(mesh, time, mesh.rest)
        away = points - points.mean(axis=0)
        squares = np.linalg.eigvalsh(away.T @ away)
        return bool(squares[0] <= options.flat**2 * squares[1])
    return False


class _Views(NamedTuple):
    """Where things are that move, at a few times.

    middles: of each (N, 3); boxes: of all that it is with, (N, 2, 3).
    """

    middles: FloatArray
    boxes: FloatArray


def _views(source: StageSource, moving: BoolArray) -> _Views:
    middles, around = [np.zeros((0, 3))], [np.zeros((0, 2, 3))]
    for boxes in _boxes(source, moving, few_times(source)):
        own = boxes[moving]
        groups, group_of = merged_boxes(own, 0.0)
        middles.append(own.mean(axis=1))
        around.append(groups[group_of])
    return _Views(np.concatenate(middles), np.concatenate(around))


def _faces_away(
    source: StageSource, mesh: SourceMesh, views: _Views, options: SetOptions
) -> BoolArray:
    """Return which triangles (F,) of a mesh that stands still face away from what moves."""
    import usd_io

    time = few_times(source)[0]
    points = source.to_world(mesh, time, mesh.rest)
    box = np.stack([points.min(axis=0), points.max(axis=0)])
    gaps = gaps_between(np.concatenate([box[None], views.boxes]))[0, 1:]
    near = gaps <= options.near * longest_sides(views.boxes)
    places = np.unique(views.middles[near] if near.any() else views.middles, axis=0)
    some = np.linspace(0, len(places) - 1, min(options.views, len(places))).astype(int)
    return facing_away(points, usd_io.world_faces(mesh.handle, time), places[some])


def _boxes(source: StageSource, posed: BoolArray, times: Sequence[float]) -> Iterator[FloatArray]:
    """Yield boxes (M, 2, 3) in the world that hold each mesh, at each time that can be placed.

    posed: which meshes (M,) are read at that time; the others are at rest.
    """
    from usd_io import FrameError

    for time in times:
        poses: dict[int, Points] = {}
        for index in np.flatnonzero(posed).tolist():
            with suppress(FrameError):
                points = source.read(source.meshes[index], time)
                if points is not None:
                    poses[index] = points
        with suppress(FrameError):
            yield source.boxes(time, poses)
