"""All meshes of an input in one, looked at in poses that may show which contacts were modelled."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.intersect.ignored import CollapsedPoseError
from dtrepair.numerics.attached.touches import without_touches
from dtrepair.numerics.geometry import FloatArray, IntArray, components, vector_areas, weld_maps
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.modelled.meetings import MeetingOptions, meetings
from dtrepair.pipeline.modelled.names import numbered
from dtrepair.pipeline.modelled.together import Together, together
from dtrepair.pipeline.modelled.unrepaired import unrepaired
from dtrepair.pipeline.stages.bodies import outward_faces
from dtrepair.pipeline.stages.frames import read_frame
from dtrepair.pipeline.stages.matching import CalledPairs, Side, SidePairs
from dtrepair.pipeline.stages.rest import Rest, posed_once
from dtrepair.pipeline.stages.sources import Source, SourceMesh, placing_time, time_label

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
# When two connected parts only pass each other at rest, as long hair and the arms of a T-pose: the
# clip may show it once, and joints of small parts are bent in all of it.
PASSING = MeetingOptions(least=0.02, rooted=0.25, share=0.85, joint=0.02)


class Look(NamedTuple):
    """A pose (V, 3), some of its pairs (K, 2), their parts as keys (K,); what it is called.

    bound: What binds each triangle (F,) where the pose shows how parts lie, see `Reference`.
    """

    points: FloatArray
    pairs: IntArray
    keys: NDArray[np.int64]
    name: str
    bound: IntArray | None = None

    def of(self, chosen: BoolArray) -> Look:
        """Return the same with some of the pairs (K,) only."""
        return self._replace(pairs=self.pairs[chosen], keys=self.keys[chosen])

    def reference(self, chosen: BoolArray | None = None, *, asked: bool = False) -> Reference:
        """Return a pose that shows some of the pairs (K,) as modelled; None: all of them."""
        from dtrepair.numerics.attachments import Reference

        pairs = self.pairs if chosen is None else self.pairs[chosen]
        return Reference(self.points, pairs, self.name, asked, None if asked else self.bound)


class PlacedMeshes:
    """All meshes of a source in one: rest (V, 3), faces (F, 3), weld (V,), mesh of triangles.

    binding: what binds each mesh (M,), see `_binding`: of those of one the rests tell how they lie,
    but for those that are parted, see `together`.
    Of a repaired layer the stage below it tells, and the frames are those of that stage.
    """

    def __init__(
        self,
        source: Source,
        rests: Sequence[Rest],
        *,
        ignored: Pairs = (),
        told: CalledPairs = CalledPairs(),
    ) -> None:
        self.source = source = unrepaired(source)
        self.ignored, self.told = ignored, told
        starts = np.cumsum([0, *(len(rest.points) for rest in rests)])
        self._ends = starts[:-1].tolist(), starts[1:].tolist()
        shifted = zip(source.meshes, starts, strict=False)
        self.faces = np.concatenate([mesh.faces + start for mesh, start in shifted]).astype(
            np.int32
        )
        sizes = [len(mesh.faces) for mesh in source.meshes]
        self.mesh_of = np.repeat(np.arange(len(sizes)), sizes)
        self._time = placing_time(source, source.clip_times)
        self.rest = _placed(source, self._time, [rest.points for rest in rests])
        weld = weld_maps([self.rest[a:b] for a, b in pairwise(starts)])
        self.weld = without_touches(self.faces, weld, lambda: self._detector(self.rest, weld=weld))
        both = zip(source.meshes, rests, strict=True)
        self.binding = np.array([_binding(*each) for each in both], dtype=object)
        self._named = np.array([rest.named for rest in rests], dtype=bool)
        self._starts = starts
        for pair in (*told.attached, *told.detached):
            for side in pair:
                self._refuse_unknown(side)

    def faces_outwards(self) -> IntArray:
        """Return the triangles (F, 3), turned to face out of closed parts as for a repair."""
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

    @cached_property
    def _numbers(self) -> NDArray[np.integer]:
        """The number (F,) of each triangle's part in its mesh, as lists tell it."""
        part = np.unique(self.part_of, return_inverse=True)[1].reshape(-1)
        return numbered(part, self.mesh_of, int(part.max(initial=-1)) + 1)[1][part]

    def _refuse_unknown(self, side: Side) -> None:
        """Raise a usage error for a part that is not there."""
        if side.part == 0:
            return
        most = int(self._numbers[self.mesh_of == side.mesh].max(initial=0))
        if side.part > most:
            numbers = f"a number from 1 to {most}" if most > 1 else "no number, as it is one part"
            raise UsageError(
                f"attach or detach: {self.source.meshes[side.mesh].path} part {side.part}: "
                f"expected {numbers}; check --modelled and reports name the parts of a mesh"
            )

    def _of(self, side: Side) -> BoolArray:
        """Return which triangles (F,) are of one side of a pair that the user names."""
        own = self.mesh_of == side.mesh
        return np.asarray(own & (self._numbers == side.part) if side.part else own)

    def _called(self, pairs: IntArray, called: SidePairs) -> BoolArray:
        """Return which pairs (K, 2) of triangles are of pairs that the user names, (K,)."""
        from dtrepair.intersect.ignored import of_ignored_bodies

        whole = [(a.mesh, b.mesh) for a, b in called if not a.part and not b.part]
        mask = of_ignored_bodies(self.mesh_of[pairs], whole)
        for first, second in called:
            if first.part or second.part:
                one, other = self._of(first)[pairs], self._of(second)[pairs]
                mask |= (one & other[:, ::-1]).any(axis=1)
        return mask

    @cached_property
    def _together(self) -> Together:
        """Caches whose own points lie on each other, and in frames do not, see `together`."""
        own = (self.binding == POINTS) & ~self._named
        count = len(own)
        result = Together(np.zeros((count, count), dtype=bool), np.zeros(count, dtype=np.int64))
        if own.sum() < 2:
            return result
        with suppress(CollapsedPoseError):
            pairs = self.bind_look.pairs
            meshes = self.mesh_of[pairs]
            told = own[meshes].all(axis=1) & (meshes[:, 0] != meshes[:, 1])
            poses = (points for _, points in self.poses(MeetingOptions().samples))
            result = together(self.rest, poses, self.faces, pairs[told], self._starts)
        return result

    @cached_property
    def bind_look(self) -> Look:
        """The rests, with their contacts."""
        return self.look(self.rest, BIND_POSE)

    @property
    def bound(self) -> IntArray:
        """A number (F,) for what binds each triangle, -1 for those that nothing binds."""
        names = self.binding.astype(str)
        number = np.unique(names, return_inverse=True)[1].reshape(-1)
        # What is parted from others is bound with what it meets in frames as at rest.
        group = self._together.number
        number = np.where(group > 0, len(names) + group, number)
        number[np.isin(names, ("", STILL))] = -1
        return number[self.mesh_of].astype(np.int32)

    @property
    def one_binding(self) -> bool:
        """Whether all meshes that are bound at all are bound by the same, and none are parted."""
        if self._together.parted.any():
            return False
        return len({own for own in self.binding if own not in ("", STILL)}) < 2

    @property
    def one_part(self) -> bool:
        """Whether there is but one connected part, which is attached to nothing."""
        return len(np.unique(self.part_of)) < 2

    @cached_property
    def _detector(self) -> Detector:
        from dtrepair.intersect.detector import Detector

        return Detector(self.rest, self.faces)

    def look(self, points: FloatArray, name: str) -> Look:
        """Return a pose (V, 3) with its contacts of different parts that count or tell."""
        from dtrepair.intersect.ignored import counted_between

        pairs = self._detector(points, weld=self.weld)
        # What is flat or scaled to zero in a pose touches itself and shows nothing.
        rounded = points.astype(np.float32).astype(np.float64)
        solid = (vector_areas(rounded, self.faces) != 0.0).any(axis=1)
        pairs = pairs[np.asarray(solid)[pairs].all(axis=1)]
        pairs = pairs[counted_between(self.mesh_of[pairs], mode="both", ignored=self.ignored)]
        pairs = pairs[~self._called(pairs, self.told.detached)]
        sides = np.sort(self.part_of[pairs], axis=1)
        keys = sides[:, 0] * len(self.rest) + sides[:, 1]
        return Look(points, pairs, keys, name).of(sides[:, 0] != sides[:, 1])

    def looks(self, samples: int) -> Iterator[Look]:
        """Yield so many frames of the whole clip, or all of them.

        Frames that cannot be used are left out.
        """
        for name, points in self.poses(samples):
            with suppress(CollapsedPoseError):
                yield self.look(points, name)

    def poses(self, samples: int) -> Iterator[tuple[str, FloatArray]]:
        """Yield the names and poses (V, 3) of so many frames, or all, that can be used."""
        times = self.source.clip_times
        chosen = np.linspace(0, len(times) - 1, min(samples, len(times))).astype(int)
        for time in times[chosen].tolist():
            frame = read_frame(self.source, time)
            if frame.usable:
                points = np.concatenate([np.asarray(own, np.float64) for own in frame.spaces])
                yield f"frame {time_label(time)}", points

    def tell_by_rests(self, pairs: IntArray) -> BoolArray:
        """Return which pairs (K, 2) of triangles are of meshes of which the rests tell, (K,)."""
        meshes = self.mesh_of[pairs].reshape(-1, 2)
        first, second = self.binding[meshes].T
        same = (first == second) | (first == STILL) | (second == STILL)
        same &= ~self._together.parted[meshes[:, 0], meshes[:, 1]]
        return np.asarray((first != "") & (second != "") & same, dtype=bool)

    def detached(self) -> Reference | None:
        """Every two parts that the user calls detached, by a triangle of each; None: none."""
        from dtrepair.numerics.attachments import Reference

        if not self.told.detached:
            return None
        some = np.unique(self.part_of, return_index=True)[1].astype(np.int32)
        found = [np.zeros((0, 2), dtype=np.int32)]
        for first, second in self.told.detached:
            one, other = (some[self._of(side)[some]] for side in (first, second))
            pairs = np.stack(np.meshgrid(one, other, indexing="ij"), axis=-1).reshape(-1, 2)
            found.append(pairs[pairs[:, 0] != pairs[:, 1]])
        return Reference(self.rest, np.concatenate(found), asked=True, apart=True)

    def passing(self, look: Look) -> BoolArray:
        """Return which pairs (K, 2) of a pose are of parts that only pass each other there, (K,).

        What the user calls attached does not pass by.
        """
        asked = ~self.asked(look.pairs) & ~self.collide(look.pairs)
        poses = (points for _, points in self.poses(PASSING.samples))
        found = look.pairs[asked]
        known = meetings(look.points, poses, self.faces, found, self.part_of, options=PASSING)
        first, second = known.sides[known.passing].T.astype(np.int64)
        passing = np.isin(look.keys, first * len(self.rest) + second)
        return np.asarray(passing & asked, dtype=bool)

    def collide(self, pairs: IntArray) -> BoolArray:
        """Return which pairs (K, 2) of triangles are of a collider and another mesh, (K,).

        What meets a floor in nearly all frames stands on it, and is not attached to it, but a bolt
        is whether or not it is an instance, as the legs of a chair are to its seat.
        """
        meshes = self.source.meshes
        colliders = np.array([own.collider and not own.handle.instanced for own in meshes], bool)
        first, second = self.mesh_of[pairs].T
        return np.asarray((colliders[first] | colliders[second]) & (first != second), dtype=bool)

    def told_of(self, pairs: IntArray) -> BoolArray:
        """Return which pairs (K, 2) of triangles the user calls attached or detached, (K,)."""
        return self._called(pairs, (*self.told.attached, *self.told.detached))

    def asked(self, pairs: IntArray) -> BoolArray:
        """Return which pairs (K, 2) of triangles are of what is called attached, (K,)."""
        return self._called(pairs, self.told.attached)


def _binding(mesh: SourceMesh, rest: Rest) -> str:
    """What binds the rest of a mesh: the path of a skeleton, POINTS for its own points, or ""."""
    if mesh.handle is None:
        return ""
    if rest.named and not mesh.animated:
        return STILL
    if not (mesh.has_rest or rest.named):
        return ""
    moves = bool(mesh.handle.skinned) or len(mesh.handle.times) > 1 or posed_once(mesh)
    return mesh.handle.skeleton or (POINTS if moves else "")


def _placed(source: Source, time: float, poses: Sequence[NDArray[np.floating]]) -> FloatArray:
    """Poses of all meshes in the space of the frames: local for one mesh, else world."""
    if len(source.meshes) == 1:
        return np.asarray(poses[0], dtype=np.float64)
    both = zip(source.meshes, poses, strict=True)
    return np.concatenate([source.to_world(mesh, time, pose) for mesh, pose in both])
