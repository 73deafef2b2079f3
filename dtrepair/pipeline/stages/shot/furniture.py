"""Furniture: what stands still beside a body that bends, and is no part of it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.enclosure import solid_angles
from dtrepair.numerics.geometry import (
    FloatArray,
    components,
    triangle_areas,
    unique_edges,
    weld_map,
)
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.numerics.scale import gaps_between, longest_sides
from dtrepair.pipeline.stages.sources import Points, SourceMesh, StageSource, few_times

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class FurnitureOptions:
    """What is taken for furniture, and for a body.

    Args:
        bends: A body is what changes its edges by so much between a few frames, and ...
        holes: ... closed, but for rims that span this share of its area: no garment.
        beside: Furniture comes as near to it as this part of its size at the times looked at.
    """

    bends: float = 1e-3
    holes: float = 0.05
    beside: float = 0.1


def furniture(
    source: StageSource,
    still: BoolArray,
    sets: BoolArray,
    *,
    options: FurnitureOptions = FurnitureOptions(),
) -> BoolArray:
    """Return which meshes (M,), besides large sets, stand still beside a body that bends.

    They are in a group of their own, near the body at some time, and not in it, as an eye or a ring
    on its finger.
    """
    groups, found = _groups([mesh.path for mesh in source.meshes]), np.zeros(len(still), dtype=bool)
    asked = still & ~sets & ~np.isin(groups, groups[~still])
    # Beside a floor, or where bodies are grouped with their clothes.
    in_set, dressed = np.isin(groups, groups[sets]), np.bincount(groups)[groups] > 1
    asked &= in_set | bool((dressed & ~still).any())
    if not asked.any():
        return found
    times = few_times(source)
    for index in np.flatnonzero(~still).tolist():
        poses = poses_of(source, source.meshes[index], times)
        if is_body(source.meshes[index], poses, options):
            for other in np.flatnonzero(asked & (in_set | dressed[index])).tolist():
                found[other] |= _is_beside(source, source.meshes[other], poses, options)
                asked[other] &= not _is_in(source, source.meshes[other], poses)
    return found & asked


def _groups(paths: Sequence[str]) -> NDArray[np.int64]:
    """Return the group (M,) of each mesh: what is beneath one child of what is above all.

    A body with its clothes, /Shot/Girl/Body and /Shot/Girl/Skirt, or a floor beside the chair tell
    that these are things of a shot, not the parts of a character.
    """
    names = [path.split("/") for path in paths]
    parents = zip(*(own[:-1] for own in names), strict=False)
    shared = sum(1 for _ in takewhile(lambda own: len(set(own)) == 1, parents))
    return np.asarray(np.unique([own[shared] for own in names], return_inverse=True)[1])


class PlacedPose(NamedTuple):
    """A mesh at a time: points (V, 3) in its own space, and triangles (F, 3, 3) in the world."""

    time: float
    points: Points
    corners: FloatArray


def poses_of(source: StageSource, mesh: SourceMesh, times: Sequence[float]) -> list[PlacedPose]:
    """Return the poses of a mesh at those times that have one."""
    from usd_io import FrameError

    poses = []
    for time in times:
        with suppress(FrameError):
            points = source.read(mesh, time)
            if points is not None:
                corners = source.to_world(mesh, time, points)[mesh.faces]
                poses.append(PlacedPose(time, points, corners))
    return poses


def is_body(mesh: SourceMesh, poses: Sequence[PlacedPose], options: FurnitureOptions) -> bool:
    """Return whether a mesh bends in some poses, and its largest part is closed like skin."""
    from dtrepair.repair.strain.volumes import holes_of

    edges, rest = unique_edges(mesh.faces), mesh.rest
    if all(edge_log_ratio(rest, pose.points, edges) < options.bends for pose in poses):
        return False
    faces = weld_map(rest)[mesh.faces]
    part = components(faces, len(rest))[faces[:, 0]]
    largest = np.argmax(np.bincount(part, triangle_areas(rest, faces)))
    return bool(holes_of(rest, faces, part)[largest] <= options.holes)


def _is_beside(
    source: StageSource, mesh: SourceMesh, body: Sequence[PlacedPose], options: FurnitureOptions
) -> bool:
    """Return whether a mesh that stands still comes near a body in any of its poses."""
    from usd_io import FrameError

    for pose in body:
        with suppress(FrameError):
            points = [source.to_world(mesh, pose.time, mesh.rest), pose.corners.reshape(-1, 3)]
            boxes = np.stack([[own.min(axis=0), own.max(axis=0)] for own in points])
            if gaps_between(boxes)[0, 1] <= options.beside * longest_sides(boxes)[1]:
                return True
    return False


def _is_in(source: StageSource, mesh: SourceMesh, body: Sequence[PlacedPose]) -> bool:
    """Return whether the middle of a mesh that stands still lies in a body in all its poses."""
    from usd_io import FrameError

    for pose in body:
        with suppress(FrameError):
            middle = source.to_world(mesh, pose.time, mesh.rest.mean(axis=0, keepdims=True))
            box = pose.corners.min(axis=(0, 1)), pose.corners.max(axis=(0, 1))
            if (middle < box[0]).any() or (middle > box[1]).any():
                return False
            if abs(solid_angles(middle, pose.corners).sum()) < 2.0 * np.pi:
                return False
    return True
