"""Poses of an input that show which contacts were modelled: its bind pose, else its frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.intersect.ignored import CollapsedPoseError
from dtrepair.numerics.geometry import FloatArray, IntArray, components, vector_areas, weld_map
from dtrepair.pipeline.repair.modelled_parts import ModelledParts
from dtrepair.pipeline.stages.bodies import outward_faces
from dtrepair.pipeline.stages.frames import read_frame
from dtrepair.pipeline.stages.rest import Rest
from dtrepair.pipeline.stages.sources import Source, SourceMesh, placing_time, time_label
from dtrepair.wording import listed

if TYPE_CHECKING:
    from dtrepair.intersect.detector import Detector
    from dtrepair.numerics.attachments import Reference

BoolArray = NDArray[np.bool_]
Pairs = Sequence[tuple[int, int]]

# What the poses that show modelled contacts are called.
BIND_POSE = "bind pose"
# What binds a mesh that deforms from a pose at the default time, where no skeleton does.
POINTS = "points"
# What binds a mesh that does not move at all: it lies to all others as their rests show it.
STILL = "still"


@dataclass(frozen=True, kw_only=True)
class ReferenceOptions:
    """Which frames tell where no bind pose does.

    Args:
        samples: Frames of the whole clip that are looked at for where parts meet, at most: with
            few of them a place is taken as modelled that another frame shows to be clear.
        layer_samples: Frames that are looked at for which part lies over which.
        least: With fewer of them nothing is told: a pose or two may just be bad.
        nearly_all: Two parts are attached where they meet in this share of them.
    """

    samples: int = 33
    layer_samples: int = 9
    least: int = 5
    nearly_all: float = 0.9


class _Look(NamedTuple):
    """A pose (V, 3), some of its pairs (K, 2), their parts as keys (K,); what it is called."""

    points: FloatArray
    pairs: IntArray
    keys: NDArray[np.int64]
    name: str

    def of(self, chosen: BoolArray) -> _Look:
        """Return the same with some of the pairs (K,) only."""
        return self._replace(pairs=self.pairs[chosen], keys=self.keys[chosen])

    def reference(self, chosen: BoolArray | None = None, *, asked: bool = False) -> Reference:
        """Return a pose that shows some of the pairs (K,) as modelled; None: all of them."""
        from dtrepair.numerics.attachments import Reference

        pairs = self.pairs if chosen is None else self.pairs[chosen]
        return Reference(self.points, pairs, self.name, asked)


def modelled_references(
    source: Source,
    rests: Sequence[Rest],
    *,
    ignored: Pairs = (),
    attached: Pairs = (),
    told_by_rest: bool = False,
    options: ReferenceOptions = ReferenceOptions(),
) -> list[Reference]:
    """Poses with the contacts that each of them shows as modelled, in the space of the frames.

    Meshes that one skeleton binds, or that deform from a pose at the default time, tell by their
    rests how they lie to each other. Of meshes of two skeletons, as a rider and a horse, of what is
    moved by transforms only, and of what has no rest pose, contacts of two parts in nearly all
    frames of the whole clip are modelled: the pose in which they have fewest pairs shows where.
    The parts of a farm agree on it.

    attached: pairs (i, j) of meshes, i <= j, that the user calls attached. For two of their parts
    of which nothing of that tells, the frame with fewest of their pairs shows where. told_by_rest:
    the rests of meshes that do not move at all tell, too.
    """
    meshes = _Meshes(source, rests, ignored=ignored, attached=attached)
    if meshes.one_part:
        return []
    if told_by_rest:
        still = [not _is_animated(mesh) for mesh in source.meshes]
        meshes.binding[still] = STILL
    rest = meshes.look(meshes.rest, BIND_POSE)
    known = [rest.of(meshes.tell_by_rests(rest.pairs))]
    if not meshes.one_binding or (meshes.binding == "").any():
        looks = list(meshes.looks(options.samples))
        looks = [look.of(~meshes.tell_by_rests(look.pairs)) for look in looks]
        if len(looks) >= options.least:
            known += _where_fewest(looks, options.nearly_all * len(looks))
    found = [look.reference(~meshes.asked(look.pairs)) for look in known]
    if not attached:
        return found
    found += [look.reference(meshes.asked(look.pairs), asked=True) for look in known]
    told = np.concatenate([look.keys for look in known])
    looks = [
        look.of(meshes.asked(look.pairs) & ~np.isin(look.keys, told))
        for look in meshes.looks(options.samples)
    ]
    every = (look.reference(asked=True) for look in _where_fewest(looks, 1))
    return [*found, *every]


def layer_poses(
    source: Source,
    rests: Sequence[Rest],
    *,
    options: ReferenceOptions = ReferenceOptions(),
) -> list[Reference]:
    """Poses that show which part lies over which, in the space of the frames, with all their pairs.

    The rests, unless some are frames of the clip, which need not be the same one, or several
    skeletons bind them. Where parts meet in them, frames of the whole clip tell as well: the parts
    of a farm agree on them.
    """
    meshes = _Meshes(source, rests)
    if meshes.one_part:
        return []
    rest = meshes.look(meshes.rest, BIND_POSE)
    shared = (not any(rest.of_frame for rest in rests) and meshes.one_binding) or len(rests) == 1
    if shared and len(rest.pairs) == 0:
        return [rest.reference()]
    looks = [look.reference() for look in meshes.looks(options.layer_samples)]
    return [rest.reference(), *looks] if shared or not looks else looks


def untold_contacts(
    source: Source,
    rests: Sequence[Rest],
    *,
    ignored: Pairs = (),
    attached: Pairs = (),
    options: ReferenceOptions = ReferenceOptions(),
) -> list[str]:
    """Say which meshes have parts that meet, while nothing tells whether they were modelled so."""
    if len(source.all_times) >= options.least:
        return []
    meshes = _Meshes(source, rests, ignored=ignored, attached=attached)
    if meshes.one_part:
        return []
    looks = list(meshes.looks(options.least))
    found = [look.pairs for look in looks]
    untold = [own[~(meshes.tell_by_rests(own) | meshes.asked(own))] for own in found]
    met = np.unique(meshes.mesh_of[np.concatenate(untold)]).tolist() if untold else []
    if not met:
        return []
    names = listed([source.meshes[index].path for index in met])
    return [
        f"different parts of {names} meet, and with no bind pose and fewer than {options.least} "
        "frames nothing tells whether they were modelled so: every contact is repaired; name a "
        "pose that shows what was with --rest, or call prims attached with --attach"
    ]


def modelled_parts(
    source: Source,
    *,
    ignored: Pairs = (),
    attached: Pairs = (),
    auto: bool = True,
    rests: Sequence[Rest] | None = None,
) -> ModelledParts:
    """What was modelled as overlapping, by the triangles of all meshes in a row, with its parts.

    By the meshes' own rests: those that have none do not need any; or by `rests`, which tell of
    meshes that do not move at all, too. attached: as `modelled_references` takes them; without
    `auto` nothing else counts as modelled.
    """
    from dtrepair.numerics.overlaps import find_attachments

    if not (auto or attached):
        return ModelledParts(source, None)
    known = rests is not None
    rests = [Rest(mesh.rest, "") for mesh in source.meshes] if rests is None else rests
    references = modelled_references(
        source, rests, ignored=ignored, attached=attached, told_by_rest=known
    )
    references = [reference for reference in references if auto or reference.asked]
    meshes = _Meshes(source, rests)
    faces = meshes.weld[meshes.faces_outwards()]
    attachments = find_attachments(faces, len(meshes.rest), references)
    return ModelledParts(source, attachments if len(attachments.zones) else None, references)


class _Meshes:
    """All meshes of a source in one: rest (V, 3), faces (F, 3), weld (V,), mesh of triangles.

    binding: what binds each mesh (M,), see `_binding`: of those of one the rests tell how they lie.
    """

    def __init__(
        self,
        source: Source,
        rests: Sequence[Rest],
        *,
        ignored: Pairs = (),
        attached: Pairs = (),
    ) -> None:
        self.source, self.ignored, self.attached = source, ignored, attached
        starts = np.cumsum([0, *(len(rest.points) for rest in rests)])
        self._ends = starts[:-1].tolist(), starts[1:].tolist()
        shifted = zip(source.meshes, starts, strict=False)
        self.faces = np.concatenate([mesh.faces + start for mesh, start in shifted]).astype(
            np.int32
        )
        sizes = [len(mesh.faces) for mesh in source.meshes]
        self.mesh_of = np.repeat(np.arange(len(sizes)), sizes)
        self._time = placing_time(source, source.all_times)
        self.rest = _placed(source, self._time, [rest.points for rest in rests])
        welded = [weld_map(self.rest[a:b]) + a for a, b in pairwise(starts)]
        self.weld = np.concatenate(welded).astype(np.int32)
        both = zip(source.meshes, rests, strict=True)
        self.binding = np.array([_binding(*each) for each in both], dtype=object)

    def faces_outwards(self) -> IntArray:
        """Return the triangles (F, 3) as a repair has them: facing out of closed parts."""
        from dtrepair.repair.surface.containment import meshes_oriented_outwards

        time, several = self._time, len(self.source.meshes) > 1
        meshes = [
            (self.rest[start:end], outward_faces(mesh, time) if several else mesh.faces)
            for mesh, start, end in zip(self.source.meshes, *self._ends, strict=True)
        ]
        outwards = zip(meshes_oriented_outwards(meshes), self._ends[0], strict=True)
        return np.concatenate([faces + start for faces, start in outwards]).astype(np.int32)

    @cached_property
    def part_of(self) -> NDArray[np.int64]:
        """The connected part of each triangle (F,)."""
        label = components(self.weld[self.faces], len(self.rest))
        return label[self.weld[self.faces[:, 0]]].astype(np.int64)

    @property
    def one_binding(self) -> bool:
        """Whether all meshes that are bound at all are bound by the same."""
        return len({own for own in self.binding if own not in ("", STILL)}) < 2

    @property
    def one_part(self) -> bool:
        """Whether there is but one connected part, which is attached to nothing."""
        return len(np.unique(self.part_of)) < 2

    @cached_property
    def _detector(self) -> Detector:
        from dtrepair.intersect.detector import Detector

        return Detector(self.rest, self.faces)

    def look(self, points: FloatArray, name: str) -> _Look:
        """Return a pose (V, 3) with its contacts of different parts that are not ignored."""
        from dtrepair.intersect.ignored import counted_between

        pairs = self._detector(points, weld=self.weld)
        # What is flat or scaled to zero in a pose touches itself and shows nothing.
        rounded = points.astype(np.float32).astype(np.float64)
        solid = (vector_areas(rounded, self.faces) != 0.0).any(axis=1)
        pairs = pairs[np.asarray(solid)[pairs].all(axis=1)]
        pairs = pairs[counted_between(self.mesh_of[pairs], mode="both", ignored=self.ignored)]
        sides = np.sort(self.part_of[pairs], axis=1)
        keys = sides[:, 0] * len(self.rest) + sides[:, 1]
        return _Look(points, pairs, keys, name).of(sides[:, 0] != sides[:, 1])

    def looks(self, samples: int) -> Iterator[_Look]:
        """Yield so many frames of the whole clip, or all of them.

        Frames that cannot be used are left out.
        """
        times = self.source.all_times
        chosen = np.linspace(0, len(times) - 1, min(samples, len(times))).astype(int)
        for time in times[chosen].tolist():
            frame = read_frame(self.source, time)
            if frame.usable:
                points = np.concatenate([np.asarray(own, np.float64) for own in frame.spaces])
                with suppress(CollapsedPoseError):
                    yield self.look(points, f"frame {time_label(time)}")

    def tell_by_rests(self, pairs: IntArray) -> BoolArray:
        """Return which pairs (K, 2) of triangles are of meshes of which the rests tell, (K,)."""
        first, second = self.binding[self.mesh_of[pairs]].reshape(-1, 2).T
        same = (first == second) | (first == STILL) | (second == STILL)
        return np.asarray((first != "") & (second != "") & same, dtype=bool)

    def asked(self, pairs: IntArray) -> BoolArray:
        """Return which pairs (K, 2) of triangles are of meshes that are called attached, (K,)."""
        from dtrepair.intersect.ignored import of_ignored_bodies

        return of_ignored_bodies(self.mesh_of[pairs], self.attached)


def _where_fewest(looks: list[_Look], least: float) -> list[_Look]:
    """For two parts that meet in enough poses, the pose in which they have fewest pairs."""
    if not looks:
        return []
    keys, counts = zip(*(np.unique(look.keys, return_counts=True) for look in looks), strict=True)
    every, seen = np.unique(np.concatenate(keys), return_counts=True)
    every = every[seen >= least]
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
        look.of(np.isin(look.keys, every[where == index]))
        for index, look in enumerate(looks)
        if (where == index).any()
    ]


def _binding(mesh: SourceMesh, rest: Rest) -> str:
    """What binds the rest of a mesh: the path of a skeleton, POINTS for its own points, or ""."""
    if mesh.handle is None:
        return ""
    if rest.named and not _is_animated(mesh):
        return STILL
    moves = bool(mesh.handle.skinned) or len(mesh.handle.times) > 1
    if not (mesh.has_rest or rest.named):
        return ""
    return mesh.handle.skeleton or (POINTS if moves else "")


def _is_animated(mesh: SourceMesh) -> bool:
    """Whether a mesh changes over time, or is moved."""
    if mesh.handle is None:
        return False
    import usd_io

    return len(mesh.handle.times) > 1 or len(usd_io.transform_times(mesh.handle)) > 1


def _placed(source: Source, time: float, poses: Sequence[NDArray[np.floating]]) -> FloatArray:
    """Poses of all meshes in the space of the frames: local for one mesh, else world."""
    if len(source.meshes) == 1:
        return np.asarray(poses[0], dtype=np.float64)
    both = zip(source.meshes, poses, strict=True)
    return np.concatenate([source.to_world(mesh, time, pose) for mesh, pose in both])
