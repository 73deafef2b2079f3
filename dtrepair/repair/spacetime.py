"""Many frames at once: displacements that are smooth in time by construction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.geometry import FloatArray, IntArray
from dtrepair.repair.contact import contact_scale
from dtrepair.repair.crew import Crew
from dtrepair.repair.regional import regional_push
from dtrepair.repair.rigid import allowed
from dtrepair.repair.soften import Softener, soften
from dtrepair.repair.surface import BoolArray, Surface
from dtrepair.repair.timeline import undamped

# Poses that moved by less than this since they were detected keep their pairs.
STALE = 2e-5
# Contacts within this many rings, next to the input's own such contacts, are folds.
FOLD_RINGS = 12
# Contacts of triangles this close in the rest pose and in SAMPLES frames of the input, yet clean in
# the input: lips, eyelids.
CLOSE, SAMPLES = 0.05, 7
# Weight of the springs between vertices that touch in close contacts.
SPRING = 20.0
# Softening levels at which folds and close contacts are pushed as well.
PUSH_FOLD, PUSH_CLOSE = 5.5, 7.5
# Close contacts that were hit more often are softened as folds too.
STUBBORN = 8.0


Levels = NDArray[np.float32]


class Snapshot(NamedTuple):
    """Everything that a sweep changes."""

    smooth: FloatArray
    extra: FloatArray
    fold_hits: Levels
    close_hits: Levels
    pairs: tuple[IntArray, ...]


class SpaceTime:
    """The frames of one window on their way to be clean.

    Unknowns Q (T, V, 3) with displacement D = K Q, K a Gaussian in time: `smooth` holds D. Each
    frame's pose is its input moved by D, softened around close contacts, softened around folds,
    plus `extra`, the corrections of single frames.
    """

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        frames: FloatArray,
        crew: Crew,
        *,
        farthest: float | None = None,
        clearance: float = 0.0,
    ) -> None:
        """Take poses (T, V, 3) in units of the surface's size at times `frames` (T,).

        farthest: no vertex moves farther; clearance: closer pairs count, as long as it is set.
        """
        self.farthest, self.clearance = farthest, clearance
        self.surface, self.original, self.frames, self.crew = surface, original, frames, crew
        self.squared = (surface.uniform.T @ surface.uniform).tocsr()
        self.folds = Softener(surface, self.squared, frames, first=3.0, highest=8.0)
        self.closes = Softener(surface, self.squared, frames, first=4.0, highest=10.0)
        self.smooth = np.zeros_like(original)
        self.extra = np.zeros_like(original)
        self.poses = original.copy()
        # Frames that no solver could clean must not keep the others from being tightened.
        self.given_up: frozenset[int] = frozenset()
        self.springs = np.zeros(0, dtype=np.int64)
        self._detected = np.full_like(original, np.nan)
        self.pairs: list[IntArray] = [np.zeros((0, 2), dtype=np.int32)] * len(original)
        self.detect()
        self.in_fold = self._input_folds()
        self.scale = contact_scale(surface, np.concatenate(self.pairs))

    @property
    def dirty(self) -> list[int]:
        """Frames with pairs left, but for those given up."""
        found = (frame for frame, pairs in enumerate(self.pairs) if len(pairs))
        return [frame for frame in found if frame not in self.given_up]

    @property
    def remaining(self) -> int:
        """Pairs left in the dirty frames."""
        return sum(len(self.pairs[frame]) for frame in self.dirty)

    def detect(self) -> None:
        """Pairs of every frame that moved since it was last detected."""
        motion = np.abs(self.poses - self._detected).max(axis=(1, 2), initial=0.0)
        moved = np.flatnonzero(~(motion <= STALE))
        found = self.crew.map(self._pairs, moved.tolist())
        for frame, pairs in zip(moved, found, strict=True):
            self.pairs[frame] = pairs
            self._detected[frame] = self.poses[frame]

    def forget_clearance(self) -> None:
        """From now on only intersecting pairs count."""
        if self.clearance > 0.0:
            self.clearance = 0.0
            self._detected[:] = np.nan
            self.detect()

    def _pairs(self, surface: Surface, frame: int) -> IntArray:
        if self.clearance > 0.0:
            return surface.close_pairs(self.poses[frame], self.clearance)
        return surface.pairs(self.poses[frame])

    def evaluate(self) -> None:
        """Poses from the unknowns, and their pairs."""

        def pose(surface: Surface, frame: int) -> FloatArray:
            moved = soften(self.closes.patch(frame), self.smooth[frame])
            shape = soften(self.folds.patch(frame), self.original[frame] + moved)
            shape = shape + self.extra[frame]
            return allowed(surface.rigid, self.original[frame], shape, self.farthest)

        for frame, points in enumerate(self.crew.map(pose, range(len(self.original)))):
            self.poses[frame] = points
        self.detect()

    def sweep(self, kernel: FloatArray, width: float, step: float) -> FloatArray:
        """Push and soften once; the displacement that the push added (T, V, 3)."""
        dirty = self.dirty
        kinds = [self._classified(frame) for frame in dirty]
        jobs = [(f, pushed) for f, pushed in zip(dirty, kinds, strict=True) if pushed.any()]

        def push(surface: Surface, job: tuple[int, BoolArray]) -> FloatArray:
            frame, pushed = job
            return regional_push(
                surface, self.poses[frame], self.pairs[frame], pushed, step=self.scale * step
            )

        added = np.zeros_like(self.original)
        for (frame, _), moved in zip(jobs, self.crew.map(push, jobs), strict=True):
            added[frame] = moved
        if jobs:
            added = undamped(kernel, added)
            self.smooth = self.smooth + added
        width = max(width, 2.0)
        self.folds.update(width)
        self.closes.update(width)
        self.evaluate()
        return added

    def snapshot(self) -> Snapshot:
        """The state now; arrays that sweeps replace are not copied."""
        hits = self.folds.hits.copy(), self.closes.hits.copy()
        return Snapshot(self.smooth, self.extra, *hits, tuple(self.pairs))

    def restore(self, state: Snapshot, width: float) -> None:
        """Go back to a state."""
        self.smooth, self.extra = state.smooth, state.extra
        self.folds.hits, self.closes.hits = state.fold_hits.copy(), state.close_hits.copy()
        self.folds.update(max(width, 2.0))
        self.closes.update(max(width, 2.0))
        self.evaluate()

    def _input_folds(self) -> list[BoolArray]:
        """Triangles (F,) of each frame within a ring of the input's own folds."""
        result = []
        for pairs in self.pairs:
            near = self.surface.queries.ring_distance(pairs) <= FOLD_RINGS
            touched = self.surface.vertices_of(pairs[near])
            result.append(self.surface.triangles_at(touched))
        return result

    def _classified(self, frame: int) -> BoolArray:
        """Raise the levels of a frame's near contacts; which pairs (K,) are to be pushed."""
        surface, pairs = self.surface, self.pairs[frame]
        near = surface.queries.ring_distance(pairs) <= FOLD_RINGS
        own_fold = self.in_fold[frame][pairs].any(axis=1)
        close = self._always_close(pairs) & ~own_fold
        fold = near & own_fold
        corners = surface.faces[pairs].reshape(-1, 6)
        hard_fold = self.folds.levels[frame][corners].max(axis=1, initial=0.0) >= PUSH_FOLD
        hard_close = self.closes.levels[frame][corners].max(axis=1, initial=0.0) >= PUSH_CLOSE
        if fold.any():
            self.folds.hit(frame, surface.vertices_of(pairs[fold]))
        if close.any():
            self._couple(frame, pairs[close])
            touched = surface.vertices_of(pairs[close])
            self.closes.hit(frame, touched)
            stubborn = touched & (self.closes.hits[frame] > STUBBORN)
            if stubborn.any():
                self.folds.hit(frame, stubborn)
        return ~(close | fold) | (fold & hard_fold) | (close & hard_close)

    def _always_close(self, pairs: IntArray) -> BoolArray:
        """Which pairs (K,) are close in the rest pose and in samples of the input."""
        samples = np.linspace(0, len(self.original) - 1, SAMPLES).astype(int)
        close = np.ones(len(pairs), dtype=bool)
        for points in (self.surface.rest, *self.original[np.unique(samples)]):
            first, second = (points[self.surface.faces[pairs[:, k]]].mean(axis=1) for k in (0, 1))
            close &= np.linalg.norm(first - second, axis=1) < CLOSE
        return close

    def _couple(self, frame: int, pairs: IntArray) -> None:
        """Springs between the nearest vertices of touching triangles, for all frames."""
        surface, points = self.surface, self.original[frame]
        first, second = surface.faces[pairs[:, 0]], surface.faces[pairs[:, 1]]
        distance = np.linalg.norm(points[first][:, :, None] - points[second][:, None], axis=3)
        ends = [
            (first, np.take_along_axis(second, distance.argmin(axis=2), axis=1)),
            (np.take_along_axis(first, distance.argmin(axis=1), axis=1), second),
        ]
        i = np.concatenate([a.ravel() for a, _ in ends]).astype(np.int64)
        j = np.concatenate([b.ravel() for _, b in ends]).astype(np.int64)
        keys = np.minimum(i, j) * surface.count + np.maximum(i, j)
        springs = np.union1d(self.springs, keys[i != j])
        if len(springs) == len(self.springs):
            return
        self.springs = springs
        self.closes.replace_matrix(self.squared + SPRING * self._spring_matrix())

    def _spring_matrix(self) -> sparse.csr_matrix:
        count = self.surface.count
        i, j = self.springs // count, self.springs % count
        half = sparse.coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count))
        links = (half + half.T).tocsr()
        degree = np.maximum(np.asarray(links.sum(axis=1)).ravel(), 1.0)
        scale = sparse.diags(1.0 / np.sqrt(degree))
        links = (scale @ links @ scale).tocsr()
        return (sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links).tocsr()
