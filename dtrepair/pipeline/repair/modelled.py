"""Poses of an input that show which contacts were modelled: its bind pose, else its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray, components, weld_map
from dtrepair.pipeline.repair.modelled_parts import ModelledParts
from dtrepair.pipeline.stages.rest import Rest
from dtrepair.pipeline.stages.sources import Source, SourceMesh, time_label

if TYPE_CHECKING:
    from dtrepair.numerics.attachments import Reference

# What the poses that show modelled contacts are called.
BIND_POSE = "bind pose"


@dataclass(frozen=True, kw_only=True)
class ReferenceOptions:
    """Which frames tell where no bind pose does.

    Args:
        samples: Frames of the whole clip that are looked at, at most.
        least: With fewer of them nothing is told: a pose or two may just be bad.
        nearly_all: Two parts are attached where they meet in this share of them.
    """

    samples: int = 9
    least: int = 5
    nearly_all: float = 0.9


class _Look(NamedTuple):
    """A pose (V, 3), its pairs (K, 2) that no bind pose speaks of, and their parts as keys (K,).

    name: what messages call it.
    """

    points: FloatArray
    pairs: IntArray
    keys: NDArray[np.int64]
    name: str


def modelled_references(
    source: Source,
    rests: Sequence[Rest],
    *,
    ignored: Sequence[tuple[int, int]] = (),
    options: ReferenceOptions = ReferenceOptions(),
) -> list[Reference]:
    """Poses with the contacts that each of them shows as modelled, in the space of the frames.

    Meshes that a skeleton binds, or that deform from a pose at the default time, tell by their
    rests how they lie to each other. Of what is moved by transforms only, and of what has no rest
    pose, contacts of two parts in nearly all frames of the whole clip are modelled: the pose in
    which they have fewest pairs shows where. The parts of a farm agree on it.
    """
    from dtrepair.intersect.detector import Detector
    from dtrepair.intersect.ignored import counted_between
    from dtrepair.numerics.attachments import Reference

    meshes = _Meshes(source, rests)
    faces, mesh_of, rest, weld = meshes.faces, meshes.mesh_of, meshes.rest, meshes.weld
    bound = np.array([_is_bound(mesh) for mesh in source.meshes])
    detector = Detector(rest, faces)

    def pairs_of(points: FloatArray) -> tuple[IntArray, NDArray[np.bool_]]:
        """Pairs (K, 2) that count, and which of them are of bound meshes alone (K,)."""
        pairs = detector(points, weld=weld)
        pairs = pairs[counted_between(mesh_of[pairs], mode="both", ignored=ignored)]
        return pairs, np.asarray(bound[mesh_of[pairs]].all(axis=1))

    pairs, known = pairs_of(rest)
    found = [Reference(rest, pairs[known], BIND_POSE)]
    if bound.all():
        return found
    part = components(weld[faces], len(rest))[weld[faces[:, 0]]].astype(np.int64)
    count = min(options.samples, len(source.all_times))
    chosen = np.linspace(0, len(source.all_times) - 1, count).astype(int)
    looks = []
    for time in source.all_times[chosen].tolist():
        poses = [source.read(mesh, time) for mesh in source.meshes]
        if any(pose is None for pose in poses):
            continue
        points = _placed(source, time, [pose for pose in poses if pose is not None])
        pairs, known = pairs_of(points)
        sides = np.sort(part[pairs[~known]], axis=1)
        keys = sides[:, 0] * len(rest) + sides[:, 1]
        looks.append(_Look(points, pairs[~known], keys, f"frame {time_label(time)}"))
    if len(looks) >= options.least:
        found += _of_nearly_all(looks, options)
    return found


def modelled_parts(source: Source, *, ignored: Sequence[tuple[int, int]] = ()) -> ModelledParts:
    """What was modelled as overlapping, by the triangles of all meshes in a row, with its parts.

    By the meshes' own rests: those that have none do not need any.
    """
    from dtrepair.numerics.attachments import find_attachments

    rests = [Rest(mesh.rest, "") for mesh in source.meshes]
    references = modelled_references(source, rests, ignored=ignored)
    meshes = _Meshes(source, rests)
    attachments = find_attachments(meshes.weld[meshes.faces], len(meshes.rest), references)
    return ModelledParts(source, attachments if len(attachments.zones) else None, references)


class _Meshes:
    """All meshes of a source in one: rest (V, 3), faces (F, 3), weld (V,), mesh of triangles."""

    def __init__(self, source: Source, rests: Sequence[Rest]) -> None:
        starts = np.cumsum([0, *(len(rest.points) for rest in rests)])
        shifted = zip(source.meshes, starts, strict=False)
        self.faces = np.concatenate([mesh.faces + start for mesh, start in shifted]).astype(
            np.int32
        )
        sizes = [len(mesh.faces) for mesh in source.meshes]
        self.mesh_of = np.repeat(np.arange(len(sizes)), sizes)
        self.rest = _placed(source, float(source.all_times[0]), [rest.points for rest in rests])
        welded = [weld_map(self.rest[a:b]) + a for a, b in pairwise(starts)]
        self.weld = np.concatenate(welded).astype(np.int32)


def _of_nearly_all(looks: list[_Look], options: ReferenceOptions) -> list[Reference]:
    """For contacts of two parts in nearly all poses, the pose in which they have fewest pairs."""
    from dtrepair.numerics.attachments import Reference

    keys, counts = zip(*(np.unique(look.keys, return_counts=True) for look in looks), strict=True)
    every, seen = np.unique(np.concatenate(keys), return_counts=True)
    every = every[seen >= options.nearly_all * len(looks)]
    fewest = np.full(len(every), np.iinfo(np.int64).max)
    where = np.zeros(len(every), dtype=np.int64)
    for index, (own, number) in enumerate(zip(keys, counts, strict=True)):
        place = np.searchsorted(own, every)
        there = np.zeros(len(every), dtype=bool)
        inside = place < len(own)
        there[inside] = own[place[inside]] == every[inside]
        fewer = there.copy()
        fewer[there] = number[place[there]] < fewest[there]
        fewest[fewer], where[fewer] = number[place[fewer]], index
    return [
        Reference(look.points, look.pairs[np.isin(look.keys, every[where == index])], look.name)
        for index, look in enumerate(looks)
        if (where == index).any()
    ]


def _is_bound(mesh: SourceMesh) -> bool:
    """Whether the rest of a mesh tells how it lies to other bound ones."""
    if mesh.handle is None:
        return False
    moves = bool(mesh.handle.skinned) or len(mesh.handle.times) > 1
    return mesh.has_rest and moves


def _placed(source: Source, time: float, poses: Sequence[NDArray[np.floating]]) -> FloatArray:
    """Poses of all meshes in the space of the frames: local for one mesh, else world."""
    if len(source.meshes) == 1:
        return np.asarray(poses[0], dtype=np.float64)
    both = zip(source.meshes, poses, strict=True)
    return np.concatenate([source.to_world(mesh, time, pose) for mesh, pose in both])
