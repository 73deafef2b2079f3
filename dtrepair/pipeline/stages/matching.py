"""Which meshes of an input an option speaks of, by a path expression; which are the set around."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.enclosure import facing_away
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.scale import gaps_between, sets_among
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import ObjectSettings
from dtrepair.pipeline.stages.rest import posed_once
from dtrepair.pipeline.stages.sources import (
    Points,
    Source,
    SourceMesh,
    StageSource,
    few_times,
)

Pairs = Sequence[tuple[int, int]]

# What stands still is of the set if it is so many times as large as all that moves; if it is flat,
# as a floor or a wall, much less is enough. What is flat is at most so thick, next to its width.
LARGER, FLAT_LARGER, FLAT = 2.0, 1.25, 0.1
# From so many points of what moves, at each time, it is seen which way a set faces.
SEEN_FROM = 8


def matching_meshes(source: Source, expression: str, option: str) -> list[int]:
    """Indices of the selected meshes that a path expression matches, or a prim above them.

    A usage error that names `option` if there is none, also of one of several expressions.
    """
    found = meshes_matched(source, expression, option)
    if not found:
        raise UsageError(f"{option}: {no_match(source)}")
    from usd_io.read.select import union_terms

    for term in union_terms(expression):
        if not meshes_matched(source, term, option):
            raise UsageError(f"{option} {term}: {no_match(source)}")
    return found


def no_match(source: Source) -> str:
    """Say that a path expression matches no mesh of a source."""
    known = ", ".join(mesh.path for mesh in source.meshes[:3])
    more = " ..." if len(source.meshes) > 3 else ""
    return f"matches none of the selected meshes ({known}{more})"


def meshes_matched(source: Source, expression: str, option: str) -> list[int]:
    """Indices of the selected meshes that a path expression matches, or a prim above them.

    A usage error that names `option` for a malformed expression.
    """
    if not isinstance(source, StageSource):
        raise UsageError(f"{option}: only for USD stages; leave it out")
    from usd_io import SelectionError
    from usd_io.read.select import matching_paths

    try:
        paths = matching_paths(source.opened.stage, expression.strip())
    except SelectionError as error:
        raise UsageError(f"{option}: {error}") from None
    matched = {str(path) for path in paths}
    return [
        index
        for index, mesh in enumerate(source.meshes)
        if any(above in matched for above in _with_parents(mesh.path))
    ]


def ignored_pairs(source: Source, texts: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Pairs of meshes (i, j), i <= j, that texts "A,B" of --ignore name."""
    return named_pairs(source, texts, "--ignore")


def find_sets(source: Source, each: Sequence[ObjectSettings]) -> None:
    """Take meshes of the set around for colliders; a character that stands still is none.

    By what is seen at three times of the whole clip. each: the settings of each mesh; what stands
    still and has a mobility of its own is none, and measures nothing.
    """
    if not isinstance(source, StageSource) or len(source.meshes) < 2:
        return
    meshes = source.meshes
    named = np.array([own.collider for own in meshes])
    moving = np.array([own.animated or bool(own.handle.skinned) for own in meshes])
    if not moving.any():  # a single pose
        moving = np.array([posed_once(own) for own in meshes])
    still = named | ~moving
    asked = np.flatnonzero(~still | [own.mobility is None for own in each])
    if not still[asked].any() or still[asked].all():
        return
    times = few_times(source)
    flat = np.array([_is_flat(own.rest) for own in meshes]) & still

    def large(boxes: FloatArray) -> NDArray[np.bool_]:
        """Return which meshes (M,) are large by their boxes (M, 2, 3)."""
        found = np.zeros(len(meshes), dtype=bool)
        known = boxes[asked], still[asked]
        found[asked] = sets_among(*known, LARGER) | (flat[asked] & sets_among(*known, FLAT_LARGER))
        return found

    sets = large(source.boxes(times[0]))
    for time in times if sets.any() else ():
        sets &= large(source.boxes(time, _poses(source, np.flatnonzero(~still).tolist(), time)))
    if sets.any():
        seen = [_some_points(source, np.flatnonzero(moving).tolist(), time) for time in times]
        away = partial(_facing_away, source, time=times[0], points=np.concatenate(seen))
        source.meshes = tuple(
            replace(mesh, collider=True, of_set=not mesh.collider, around=away(mesh))
            if own
            else mesh
            for mesh, own in zip(meshes, sets.tolist(), strict=True)
        )


def _is_flat(points: FloatArray) -> bool:
    """Return whether points (V, 3) lie about one plane, however that is turned."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(len(spread) < 3 or spread[2] <= FLAT * spread[1])


def _some_points(source: StageSource, chosen: Sequence[int], time: float) -> FloatArray:
    """Return a few points (N, 3) of meshes at a time, in the world."""
    poses = _poses(source, chosen, time)
    placed = [source.to_world(source.meshes[k], time, own) for k, own in poses.items()]
    every = np.concatenate([np.zeros((0, 3)), *placed])
    some = np.linspace(0, len(every) - 1, min(SEEN_FROM, len(every))).astype(int)
    return np.asarray(every[some])


def _facing_away(
    source: StageSource, mesh: SourceMesh, *, time: float, points: FloatArray
) -> NDArray[np.bool_]:
    """Return which triangles (F,) of a mesh face away from points (N, 3) in the world."""
    import usd_io

    faces = usd_io.world_faces(mesh.handle, time)
    return facing_away(source.to_world(mesh, time, mesh.rest), faces, points)


def _poses(source: StageSource, chosen: Sequence[int], time: float) -> dict[int, Points]:
    """Return the points (V, 3) of meshes at a time, by index, where they have any."""
    from usd_io import FrameError

    found = {}
    for index in chosen:
        with suppress(FrameError):
            points = source.read(source.meshes[index], time)
            if points is not None:
                found[index] = points
    return found


def pairs_beside(source: Source, pairs: Pairs) -> list[tuple[int, int]]:
    """Return which pairs of meshes are beside each other at one of three times of the whole clip.

    What moves is beside no set: it stands on it.
    """
    if not isinstance(source, StageSource):
        return list(pairs)
    pairs = [own for own in pairs if not any(source.meshes[k].around is not None for k in own)]
    if not pairs:
        return []
    every = range(len(source.meshes))
    gaps = np.min(
        [gaps_between(source.boxes(t, _poses(source, every, t))) for t in few_times(source)], axis=0
    )
    return [own for own in pairs if gaps[own] <= 0.0]


def pairs_of_sets(source: Source) -> set[tuple[int, int]]:
    """Pairs of meshes (i, j), i <= j, of the set around: what stands still is not repaired."""
    sets = [index for index, mesh in enumerate(source.meshes) if mesh.of_set]
    return {(i, j) for i in sets for j in sets if i <= j}


def named_pairs(source: Source, texts: Sequence[str], name: str) -> tuple[tuple[int, int], ...]:
    """Pairs of meshes (i, j), i <= j, that texts "A,B" name; each side may match several.

    "A,A" are the contacts of each mesh of A with itself and the others of A. A usage error that
    calls the option by its name for a text that is no pair.
    """
    pairs = set()
    for text in texts:
        sides = _split(text)
        option = f"{name} {text}"
        if len(sides) != 2 or not all(side.strip() for side in sides):
            raise UsageError(f'{option}: expected two prims, such as "/Hero/Hair,/Hero/Body"')
        first, second = (matching_meshes(source, side, option) for side in sides)
        pairs |= {(min(i, j), max(i, j)) for i in first for j in second}
    return tuple(sorted(pairs))


def attached_pairs(
    source: Source, texts: Sequence[str], each: Sequence[ObjectSettings]
) -> tuple[tuple[tuple[int, int], ...], list[str]]:
    """Pairs of meshes (i, j), i <= j, that are called attached, and warnings.

    texts: pairs "A,B" of --attach; each: the settings of each mesh, which name what it is attached
    to. What of those is not among the selected meshes is warned of.
    """
    pairs, warnings = set(named_pairs(source, texts, "--attach")), []
    for index, own in enumerate(each):
        for expression in own.attach or ():
            where = f"{source.meshes[index].path}: attach {expression}"
            found = meshes_matched(source, expression, where)
            pairs |= {(min(index, other), max(index, other)) for other in found}
            if not found:
                warnings.append(f"{where}: {no_match(source)}")
    return tuple(sorted(pairs)), warnings


def _split(text: str) -> list[str]:
    """The parts between commas that are not in the braces of a predicate."""
    parts, depth = [""], 0
    for letter in text:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _with_parents(path: str) -> list[str]:
    names = path.strip("/").split("/")
    return ["/" + "/".join(names[: count + 1]) for count in range(len(names))]
