"""How corrections go in time: jitter, frames in which they jump or break off, what gives way."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    components,
    diagonal,
    lengths,
    weld_map,
)
from dtrepair.numerics.metrics import JitterMeter, JumpMeter
from dtrepair.pipeline.stages.sources import Source, SourceMesh
from dtrepair.report.findings import FindingKind, MotionFinding


@dataclass(frozen=True, kw_only=True)
class BendOptions:
    """When a mesh that moves as a whole in the input is told to be bent.

    Args:
        rounding: Its points are at most so far from a rigid motion of the first frame, diagonals.
        farther: It is bent where a point is farther than this from where the best rigid motion of
            the input leads it, diagonals; ...
        slender, little: ... where it is at least so many times as long as it is wide, than this: a
            sword is seen to be bent before a shield is.
    """

    rounding: float = 1e-3
    farther: float = 0.02
    slender: float = 5.0
    little: float = 0.01


class BendMeter:
    """Measures by how much a repair bends a mesh that moves as a whole in the input."""

    def __init__(self, *, options: BendOptions = BendOptions()) -> None:
        self.options = options
        self._first: FloatArray | None = None
        self._farthest = 0.0
        self._moves, self._whole = False, True
        self._bends: dict[float, float] = {}

    def add(self, time: float, before: ArrayLike, after: ArrayLike) -> None:
        """Take the next frame: its time, points (V, 3) of the input and of the result."""
        original, result = np.asarray(before, np.float64), np.asarray(after, np.float64)
        size = diagonal(original) if len(original) else 0.0
        if not (self._whole and size):
            return
        if self._first is None:
            self._first, self._farthest = original, self._limit(original)
        off = self.options.rounding * size
        self._moves |= float(lengths(original - self._first).max()) > off
        self._whole = _unbent(self._first, original) <= off
        bend = _unbent(original, result) / size
        if bend > self._farthest:
            self._bends[time] = bend

    @property
    def bends(self) -> Mapping[float, float]:
        """By how much frames bend it, by their times; nothing if it deforms or rests anyway."""
        return self._bends if self._whole and self._moves else {}

    def _limit(self, points: FloatArray) -> float:
        """Return how far points (V, 3) may be off unsaid, diagonals."""
        axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        long, wide, _ = np.ptp(points @ axes.T, axis=0)
        slender = long >= self.options.slender * wide
        return self.options.little if slender else self.options.farther


class StillMeter:
    """Measures how far a repair moves a mesh that stands still in the input.

    Args:
        least: From so far on it counts, diagonals.
    """

    def __init__(self, *, least: float = 0.01) -> None:
        self.least, self.still = least, True
        self._first: FloatArray | None = None
        self._gives: dict[float, float] = {}

    def add(self, time: float, before: ArrayLike, after: ArrayLike) -> None:
        """Take the next frame: its time, points (V, 3) of the input and of the result."""
        original, result = np.asarray(before, np.float64), np.asarray(after, np.float64)
        if self._first is None:
            self._first = original
        self.still = self.still and np.array_equal(original, self._first)
        size = diagonal(original) if len(original) else 0.0
        if self.still and size:
            moved = float(lengths(result - original).max()) / size
            if moved > self.least:
                self._gives[time] = moved

    @property
    def gives(self) -> Mapping[float, float]:
        """How far frames move it, by their times; nothing if it moves anyway."""
        return self._gives if self.still else {}


def parts_of_mesh(mesh: SourceMesh) -> IntArray:
    """Return the connected part (V,) of each vertex; vertices at one place at rest are one."""
    weld = weld_map(mesh.rest)
    return components(weld[mesh.faces], len(weld))[weld]


def _edges(source: Source) -> FloatArray:
    """Return the chosen frames (N,) that have a neighbour which was not chosen."""
    every = source.all_times
    chosen = np.isin(every, source.times)
    beside = np.concatenate([[True], chosen, [True]])
    return np.asarray(every[chosen & ~(beside[:-2] & beside[2:])])


def _unbent(reference: FloatArray, points: FloatArray) -> float:
    """Return how far points (V, 3) are at most from the best rigid motion of others."""
    from dtrepair.repair.surface.rigid_bodies import RigidBodies

    whole = RigidBodies([(0, len(points))], np.ones(len(points))).fitted(reference, points)
    return float(lengths(whole - points).max())


class Motion:
    """The corrections of all meshes, frame by frame, in memory for three frames and the first.

    Args:
        source: What is repaired, with the frames that were chosen.
        least: A correction that ends in front of a frame that was not chosen breaks off where a
            vertex is farther off than this, diagonals.
    """

    def __init__(self, source: Source, *, least: float = 0.002) -> None:
        self._least = least
        self._paths = [mesh.path for mesh in source.meshes]
        self._jitter = [JitterMeter() for _ in self._paths]
        self._jumps = [JumpMeter(parts_of_mesh(mesh)) for mesh in source.meshes]
        # Of a single mesh nothing else moves.
        several = len(self._paths) > 1
        self._bends = [BendMeter() for _ in self._paths] if several else []
        self._still = [StillMeter() for _ in self._paths] if several else []
        self._frames = 0
        self._edges = set(_edges(source))
        self._next = dict(pairwise(source.all_times.tolist()))
        self._last: tuple[float, FloatArray] | None = None
        # From frame to frame of the clip: where, how fast (sizes / time) and how far (sizes).
        self._steps: list[tuple[tuple[float, float], tuple[float, float]]] = []
        self._ends: list[dict[float, float]] = [{} for _ in self._paths]

    def add(self, time: float, before: Sequence[ArrayLike], after: Sequence[ArrayLike]) -> None:
        """Take the next frame: points (V, 3) of the meshes, before and after; none if it failed."""
        self._frames += 1
        if not self._goes_on(time, before):
            for meter in self._jumps:
                meter.restart()
        meters = zip(self._jitter, self._jumps, before, after, strict=False)
        for jitter, jumps, own, repaired in meters:
            jitter.add(own, repaired)
            jumps.add(time, own, repaired)
        if time in self._edges:
            self._break_off(time, before, after)
        props = zip(self._bends, self._still, before, after, strict=False)
        for bends, still, own, repaired in props:
            bends.add(time, own, repaired)
            still.add(time, own, repaired)

    def _goes_on(self, time: float, before: Sequence[ArrayLike]) -> bool:
        """Return whether a frame is the next one of the clip, and not surely of another shot."""
        from dtrepair.repair.clip.layout import CutOptions, motion_between

        last = self._last
        pose = np.concatenate([np.zeros((0, 3)), *(np.asarray(own, float) for own in before)])
        self._last = time, pose
        if last is None or self._next.get(last[0]) != time or len(last[1]) != len(pose):
            return False
        motion = motion_between(last[1], pose)
        self._steps.append(((last[0], time), (motion / (time - last[0]), motion)))
        return motion <= CutOptions().always

    def _beside_cuts(self) -> set[float]:
        """Return the frames between which another shot begins, where meters went on."""
        from dtrepair.repair.clip.layout import CutOptions, cuts_along

        cuts, surely = cuts_along(step for _, step in self._steps), CutOptions().always
        both = zip(self._steps, cuts, strict=True)
        return {
            time
            for (frames, (_, motion)), cut in both
            if cut and motion <= surely
            for time in frames
        }

    def _break_off(
        self, time: float, before: Sequence[ArrayLike], after: Sequence[ArrayLike]
    ) -> None:
        """Take a frame beside which nothing is corrected."""
        for ends, own, repaired in zip(self._ends, before, after, strict=False):
            original = np.asarray(own, np.float64)
            size = diagonal(original) if len(original) else 0.0
            far = float(lengths(np.asarray(repaired, np.float64) - original).max()) if size else 0.0
            if far > self._least * size:
                ends[time] = far / size

    @property
    def jitter(self) -> float | None:
        """The largest jitter of a mesh, see `JitterMeter`; None for fewer than three frames."""
        return max(meter.value for meter in self._jitter) if self._frames > 2 else None

    def findings(self, worn: Collection[str] = ()) -> tuple[MotionFinding, ...]:
        """Return what is to be looked at though nothing intersects, by meshes and frames.

        worn: the paths of what is worn, which gives way as it should.
        """
        gives = [
            {} if path in worn else meter.gives
            for path, meter in zip(self._paths, self._still, strict=False)
        ]
        if all(meter.still for meter in self._still):
            gives = []
        cuts = self._beside_cuts()
        jumps = [
            {time: far for time, far in meter.jumps.items() if time not in cuts}
            for meter in self._jumps
        ]
        found: dict[FindingKind, Sequence[Mapping[float, float]]] = {
            FindingKind.BENT: [meter.bends for meter in self._bends],
            FindingKind.MOVED: gives,
            FindingKind.BREAKS_OFF: self._ends,
            FindingKind.JUMPS: jumps,
        }
        return tuple(
            MotionFinding(kind=kind, path=path, largest=max(own.values()), times=tuple(own))
            for kind, each in found.items()
            for path, own in zip(self._paths, each, strict=False)
            if own
        )
