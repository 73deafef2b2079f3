"""The rest pose of each mesh: from the input, or as --rest says."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError, UsageError
from dtrepair.pipeline.selection import ObjectSettings, Selection
from dtrepair.pipeline.stages.frames import (
    count_frame,
    make_counter,
    read_frames,
    told_unit,
)
from dtrepair.pipeline.stages.sources import Source, SourceMesh, open_source, time_label
from dtrepair.wording import counted, listed

# A clearance may be this part of the thickness of what moves, before it is questioned.
THIN = 0.1


@dataclass(frozen=True)
class Rest:
    """Rest points (V, 3) of a mesh, local space, and the words that say where they come from.

    of_frame: whether a frame of the clip was chosen to be the rest pose; named: whether the user
    named the pose.
    """

    points: NDArray[np.float64]
    origin: str
    of_frame: bool = False
    named: bool = False


def choose_rests(source: Source, option: str | None, *, device: str) -> list[Rest]:
    """Return the rest pose of each mesh.

    Default: the points at the default time, else the frame of the clip that intersects itself least
    (the first of several). An option is a time code of the input, or a file: matched by path, or,
    where both hold one mesh, as it is.
    """
    if option is None:
        return _default_rests(source, device)
    time = _as_time(option)
    if time is not None:
        if not math.isnan(time) and all(not _times(mesh) for mesh in source.meshes):
            raise UsageError(
                f"--rest {option}: nothing in {source.name} changes over time, and no file has "
                "that name; name a file, or leave it out"
            )
        rests = [_rest_at(source, mesh, time) for mesh in source.meshes]
        return [replace(rest, named=True) for rest in rests]
    other = open_source(option, Selection())
    rests = [_rest_from(other, mesh, only=len(source.meshes) == 1) for mesh in source.meshes]
    return [replace(rest, named=True) for rest in rests]


# What a repair leaves alone is not asked which of its contacts were modelled.
_UNLESS_MODELLED = ", and as it should be where its parts were modelled into each other"


def rest_warnings(
    source: Source,
    rests: Sequence[Rest],
    counts: Sequence[int | None],
    settings: Sequence[ObjectSettings],
    *,
    advise: bool = True,
) -> Iterator[str]:
    """Say in a line or two which rest poses intersect themselves, as `counts` of triangles tell.

    What was modelled is not in these counts. settings: those of each mesh; advise: say what helps,
    unless another warning does.
    """
    still, stiff, faulty = [], [], []
    each = zip(source.meshes, rests, counts, settings, strict=True)
    for mesh, rest, count, setting in each:
        # A mesh file, or points at the default time only, is its own rest pose: nothing to say.
        own = len(source.all_times) == 1 and mesh.has_rest and not rest.named
        if count and mesh.collider:
            still.append(mesh.path)
        elif count and setting.rigid and len(source.meshes) > 1:
            stiff.append(mesh.path)
        elif count and not own:
            faulty.append(f"{mesh.path} ({counted(count, 'triangle')}, {rest.origin})")
    if still:
        yield (
            f"colliders that intersect themselves: {listed(still)}; as a collider never moves, "
            f"that is neither repaired nor counted{_UNLESS_MODELLED}"
        )
    if stiff:
        yield (
            f"rigid, and intersect themselves: {listed(stiff)}; as a rigid thing keeps its shape, "
            f"that is neither repaired nor counted{_UNLESS_MODELLED}"
        )
    if faulty:
        yield (
            f"rest poses that intersect themselves: {listed(faulty)}; the repair aims at these "
            f"shapes{': give it clean ones with --rest' if advise else ''}"
        )


def thin_warnings(
    source: Source, rests: Sequence[Rest], settings: Sequence[ObjectSettings], clearance: float
) -> Iterator[str]:
    """Question a clearance, in stage units, that is wide for how thick the rest poses are.

    Meshes that move as a whole, or not at all, may be as thin as they like.
    """
    from dtrepair.repair.surface.thickness import thinnest

    if not 0.0 < clearance < math.inf:
        return
    thin = []
    for mesh, rest, own in zip(source.meshes, rests, settings, strict=True):
        if mesh.collider or own.rigid or own.mobility == 0.0:
            continue
        unit = told_unit(source, mesh, float(source.times[0]))
        thickness = unit * thinnest(rest.points, mesh.faces, clearance / (THIN * unit))
        if thickness < clearance / THIN:
            thin.append((thickness, mesh.path))
    if thin:
        thickness, path = min(thin)
        more = f" (and {counted(len(thin) - 1, 'other mesh', 'other meshes')})" if thin[1:] else ""
        yield (
            f"--clearance {clearance:g} is more than a tenth of the thickness of {path}{more}, "
            f"{thickness:.3g} where it is thin: that takes long, and bends what is thin; "
            f"is {THIN * thickness:.2g} enough?"
        )


def _default_rests(source: Source, device: str) -> list[Rest]:
    rests: list[Rest | None] = [
        Rest(mesh.rest, "default time") if mesh.has_rest else None for mesh in source.meshes
    ]
    if all(rest is not None for rest in rests):
        return [rest for rest in rests if rest is not None]
    counter = make_counter(source, mode="self", device=device)
    least = [math.inf] * len(source.meshes)
    # Frames not selected count too: the parts of a shot on a farm then share one rest pose.
    for frame in read_frames(source, source.all_times):
        frame, found = count_frame(counter, frame)
        if found is None:
            continue
        for index, count in enumerate(found.each):
            if not source.meshes[index].has_rest and count.pairs < least[index]:
                least[index] = count.pairs
                points = frame.points[index].astype(np.float64)
                rests[index] = Rest(points, f"frame {time_label(frame.time)}", of_frame=True)
        if all(best == 0 or rest for best, rest in zip(least, rests, strict=True)) and not any(
            least[i] for i, mesh in enumerate(source.meshes) if not mesh.has_rest
        ):
            break
    return [
        rest if rest is not None else Rest(mesh.rest, "first frame")
        for rest, mesh in zip(rests, source.meshes, strict=True)
    ]


def _as_time(option: str) -> float | None:
    """Return the time code an option names, None if it names a file."""
    if option == "default":
        return math.nan
    if os.path.exists(option):
        return None
    try:
        time = float(option)
    except ValueError:
        return None
    if not math.isfinite(time):
        raise UsageError(f"--rest {option}: expected a finite time code or a file")
    return time


def posed_once(mesh: SourceMesh) -> bool:
    """Whether a mesh has one time sample only, with other points than the default time."""
    import usd_io

    if not mesh.has_rest or len(times := _times(mesh)) != 1:
        return False
    try:
        (points,) = usd_io.read_points(mesh.handle, times)
    except usd_io.FrameError:
        return False
    return bool((points != mesh.rest.astype(np.float32)).any())


def _times(mesh: SourceMesh) -> list[float]:
    """The times of a mesh's own samples; none for a mesh that does not change."""
    return [] if mesh.handle is None else [t for t in mesh.handle.times if not math.isnan(t)]


def _rest_at(source: Source, mesh: SourceMesh, time: float) -> Rest:
    times = _times(mesh)
    if not times:  # among meshes that have that time: it is as it always is
        return Rest(mesh.rest, "default time")
    if not math.isnan(time) and not min(times) <= time <= max(times):
        raise UsageError(
            f"--rest {time_label(time)}: {mesh.path} has samples from {time_label(min(times))} to "
            f"{time_label(max(times))}; name a time among them"
        )
    points = source.read(mesh, time)
    if points is None:
        raise InputError(
            f"--rest {time_label(time)}: {mesh.path} has no points then; name another time"
        )
    return Rest(points.astype(np.float64), f"frame {time_label(time)}", of_frame=True)


def _rest_from(other: Source, mesh: SourceMesh, *, only: bool) -> Rest:
    matching = [found for found in other.meshes if found.path == mesh.path]
    if not matching and only and len(other.meshes) == 1:
        matching = list(other.meshes)
    if not matching:
        raise InputError(f"--rest {other.name}: has no mesh {mesh.path}; name a file that holds it")
    found = matching[0]
    if len(found.rest) != len(mesh.rest) or not np.array_equal(found.faces, mesh.faces):
        raise InputError(
            f"--rest {other.name}: {found.path} has {len(found.rest)} vertices and "
            f"{len(found.faces)} triangles, expected the topology of {mesh.path} "
            f"({len(mesh.rest)}, {len(mesh.faces)})"
        )
    return Rest(found.rest, other.name)
