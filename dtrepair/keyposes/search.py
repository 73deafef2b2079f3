"""Poses between keys: clean where the keys are, by moving keys a little or adding a few."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from dtrepair.keyposes.changes import (
    Change,
    changes,
    moved_farther,
    reach_of,
    usual_move,
)
from dtrepair.keyposes.options import KeyOptions
from dtrepair.keyposes.search_options import SearchOptions
from dtrepair.keyposes.spans import (
    KeyPoses,
    Sample,
    Solver,
    Span,
    Trial,
    cost_of,
    parts_of,
    places_for,
)
from dtrepair.keyposes.tracks import Pose, Track


def verify_in_betweens(
    tracks: Sequence[Track],
    spans: Sequence[tuple[float, float]],
    solver: Solver,
    *,
    options: KeyOptions,
    jobs: int = 1,
    check: Callable[[], None] = lambda: None,
) -> KeyPoses:
    """Count the in-betweens of spans (start, end) of neighbouring keys; nothing is changed.

    jobs: threads; check: called from time to time, and ends the search by what it raises.
    """
    search = _Search(tracks, spans, solver, options, check)
    search.measure_all(jobs)
    return search.answer(search.samples(spans))


def clean_in_betweens(
    tracks: Sequence[Track],
    spans: Sequence[tuple[float, float]],
    solver: Solver,
    *,
    options: KeyOptions,
    jobs: int = 1,
    progress: Callable[[int], None] = lambda done: None,
    check: Callable[[], None] = lambda: None,
    numbers: SearchOptions = SearchOptions(),
) -> KeyPoses:
    """Move keys or add the fewest until `options.samples` in-betweens of each span are clean.

    tracks: of each mesh; spans: (start, end) times of neighbouring keys of all tracks together.
    An added key starts a span of its own, with as many samples. Where nothing helps, the samples
    of the result say what is left. progress: called with the number of spans that are done; jobs
    and check as for `verify_in_betweens`; numbers: those of the search.
    """
    search = _Search(tracks, spans, solver, options, check, numbers)
    search.measure_all(jobs)
    before = search.samples(spans)
    for number, span in enumerate(spans):
        search.clean(span)
        progress(number + 1)
    for span in spans:
        search.leave_out(span)
    return search.answer(before)


class _Search:
    """The tracks as they are so far, and what is known about the spans between their keys."""

    def __init__(
        self,
        tracks: Sequence[Track],
        spans: Sequence[tuple[float, float]],
        solver: Solver,
        options: KeyOptions,
        check: Callable[[], None],
        numbers: SearchOptions = SearchOptions(),
    ) -> None:
        self.numbers = numbers
        self.tracks = self.given = tuple(tracks)
        self.spans = tuple(spans)
        self.solver, self.options, self.check = solver, options, check
        self.added: tuple[float, ...] = ()
        self.known: dict[tuple[float, float], tuple[Sample, ...]] = {}
        self.all_times = sorted({time for span in spans for time in span})

    def poses(self, tracks: Sequence[Track], time: float) -> tuple[Pose, ...]:
        return tuple(track.at(time, interpolation=self.options.interpolation) for track in tracks)

    @property
    def moving(self) -> tuple[Sequence[Track], Sequence[Track], str]:
        """The tracks as they are, as they were given, and how they are interpolated."""
        return self.tracks, self.given, self.options.interpolation

    def measure(self, tracks: Sequence[Track], part: tuple[float, float]) -> tuple[Sample, ...]:
        start, end = part
        count = self.options.samples
        times = {start + (end - start) * k / (count + 1) for k in range(1, count + 1)}
        times |= {time for track in tracks for time in track.frames if start < time < end}
        return tuple(
            Sample(time, self.solver.pairs(time, self.poses(tracks, time)))
            for time in sorted(times)
        )

    def measure_all(self, jobs: int) -> None:
        """Measure every span, side by side."""
        with ThreadPoolExecutor(jobs) as pool:
            try:
                found = pool.map(lambda span: self.measure(self.tracks, span), self.spans)
                for span, samples in zip(self.spans, found, strict=True):
                    self.check()
                    self.known[span] = samples
            finally:
                pool.shutdown(wait=True, cancel_futures=True)

    def samples(self, spans: Sequence[tuple[float, float]]) -> list[tuple[Sample, ...]]:
        """Return the samples of spans, those of their parts one after the other."""
        return [
            tuple(sample for part in parts_of(span, self.added) for sample in self.known[part])
            for span in spans
        ]

    def answer(self, before: Sequence[tuple[Sample, ...]]) -> KeyPoses:
        """Return the tracks and what is left between their keys."""
        after = self.samples(self.spans)
        spans = tuple(
            Span(*span, old, new, tuple(t for t in self.added if span[0] < t < span[1]))
            for span, old, new in zip(self.spans, before, after, strict=True)
        )
        return KeyPoses(self.tracks, spans)

    def clean(self, span: tuple[float, float]) -> None:
        """Move or add keys until a span is clean or nothing helps: near to the input if that will.

        Else farther from it, if that leaves less.
        """
        ways, begun = self.solver.ways, (self.tracks, self.added, dict(self.known))
        self.clean_by(ways, span)
        if (left := self.left(span)) and len(ways) > 1:
            near = self.tracks, self.added, self.known
            self.tracks, self.added, self.known = begun
            self.clean_by(ways[-1:], span)
            if self.left(span) >= left:
                self.tracks, self.added, self.known = near

    def left(self, span: tuple[float, float]) -> float:
        """Return the cost of a span."""
        return sum(cost_of(part, self.known[part]) for part in parts_of(span, self.added))

    def clean_by(self, ways: Sequence[int], span: tuple[float, float]) -> None:
        """Move or add keys until a span is clean or nothing helps, repaired in some ways."""
        hopeless: set[tuple[float, float]] = set()
        for _ in range(self.numbers.trials * (self.options.extra + 1)):
            parts = parts_of(span, self.added)
            dirty = {
                part: cost_of(part, self.known[part]) for part in parts if part not in hopeless
            }
            part = max(dirty, key=lambda item: dirty[item], default=None)
            if part is None or dirty[part] == 0.0:
                return
            short = part[1] - part[0] < self.numbers.shortest * (span[1] - span[0])
            trial = self.best_trial(ways, part, full=short or len(parts) > self.options.extra)
            if trial is None:
                hopeless.add(part)
            else:
                self.accept(trial)

    def best_trial(
        self, ways: Sequence[int], part: tuple[float, float], *, full: bool
    ) -> Trial | None:
        """Return the change that leaves least, None where none leaves less.

        full: no more keys may be added.
        """
        best: Trial | None = None
        options, cost = self.options, cost_of(part, self.known[part])
        for time in places_for(self.known[part]):
            poses = self.poses(self.tracks, time)
            most = self.farthest(part, time)
            for way, start, found in self.found(ways, part, time, poses):
                if start is poses and way == ways[0]:
                    most = self.farthest(part, time, found)
                for change in changes(
                    self.tracks,
                    time,
                    poses,
                    found,
                    added=self.added,
                    keep_keys=options.keep_keys,
                    full=full,
                    options=self.numbers.changes,
                ):
                    if moved_farther(*self.moving, change) > most:
                        continue
                    trial = self.measured(change, part)
                    if trial is None:
                        continue
                    if trial.solved:
                        return trial
                    least = -self.numbers.finer if change.added else self.numbers.least_gain
                    enough = trial.gain > cost * least
                    if enough and (best is None or trial.gain > best.gain):
                        best = trial
        return best

    def starts(
        self, part: tuple[float, float], time: float, poses: tuple[Pose, ...]
    ) -> Iterator[tuple[Pose, ...]]:
        """Yield what to repair: an in-between as it is, or displaced like an added key beside it.

        Alone, poses before and after a passage leave on opposite sides, and meet between.
        """
        yield poses
        for end in part:
            if end in self.added:
                away = (end - time) / (part[1] - part[0])
                displaced = []
                for pose, track, given in zip(poses, self.tracks, self.given, strict=True):
                    moved = track.at(end).astype(np.float64) - given.at(end)
                    displaced.append((pose + abs(away) * moved).astype(np.float32))
                yield tuple(displaced)

    def found(
        self,
        ways: Sequence[int],
        part: tuple[float, float],
        time: float,
        poses: tuple[Pose, ...],
    ) -> Iterator[tuple[int, tuple[Pose, ...], tuple[Pose, ...]]]:
        """Yield what is clean, or repaired in some ways, with the way and what it began as."""
        for start in self.starts(part, time, poses):
            self.check()
            dirty = self.solver.pairs(time, start)
            for way in ways if dirty else ways[:1]:
                own = self.solver.repair(time, start, way) if dirty else start
                if own is not None:
                    yield way, start, own

    def farthest(
        self, part: tuple[float, float], time: float, found: tuple[Pose, ...] | None = None
    ) -> float:
        """Return how far a key in a part may go, diagonals; found: what it is at a time."""
        move = usual_move(*self.moving, part, self.added, time, found)
        return self.numbers.farther * move + self.numbers.near

    def measured(self, change: Change, part: tuple[float, float]) -> Trial | None:
        """Return what a change leaves, mainly of `part`; None where a key gets pairs by it."""
        if not change.keys:
            return None
        tracks = list(self.tracks)
        for index, time, wanted in change.keys:
            pose = self.solver.allowed(index, time, self.given[index].at(time), wanted)
            tracks[index] = tracks[index].with_key(time, pose, all_times=self.all_times)
        for time in sorted({time for _, time, _ in change.keys}):
            left = self.solver.pairs(time, self.poses(tracks, time))
            allowed = 0 if time in change.added else None
            if left and allowed is None:
                allowed = self.solver.pairs(time, self.poses(self.tracks, time))
            if allowed is not None and left > allowed:
                return None
        return self.trial(tracks, (*self.added, *change.added), change, part)

    def trial(
        self,
        tracks: Sequence[Track],
        added: tuple[float, ...],
        change: Change,
        part: tuple[float, float],
    ) -> Trial:
        """Measure the spans that a change of keys reaches."""
        self.check()
        interpolation = self.options.interpolation
        low, high = reach_of(change, self.tracks, tracks, interpolation=interpolation)
        before = after = inside = 0.0
        known: dict[tuple[float, float], tuple[Sample, ...]] = {}
        for span in self.spans:
            if span[0] >= high or span[1] <= low:
                continue
            before += sum(cost_of(item, self.known[item]) for item in parts_of(span, self.added))
            for item in parts_of(span, added):
                reached = (item[0] < high and item[1] > low) or item not in self.known
                known[item] = self.measure(tracks, item) if reached else self.known[item]
                cost = cost_of(item, known[item])
                after += cost
                inside += cost if part[0] <= item[0] and item[1] <= part[1] else 0.0
        others = before - cost_of(part, self.known[part]) if part in self.known else 0.0
        solved = inside == 0.0 and after <= others
        return Trial(tuple(tracks), added, known, solved, before - after)

    def accept(self, trial: Trial) -> None:
        """Go on from a trial."""
        self.tracks, self.added = trial.tracks, trial.added
        self.known |= trial.known

    def leave_out(self, span: tuple[float, float]) -> None:
        """Take back added keys that a clean span does not need."""
        start, end = span
        for time in [t for t in sorted(self.added) if start < t < end]:
            parts = parts_of(span, self.added)
            if any(cost_of(part, self.known[part]) for part in parts):
                return
            keys = [
                (index, time, track.at(time))
                for index, track in enumerate(self.tracks)
                if time in track.changed
            ]
            tracks = [track.without_key(time) for track in self.tracks]
            added = tuple(other for other in self.added if other != time)
            trial = self.trial(tracks, added, Change(keys, ()), span)
            if trial.gain >= 0.0:
                self.accept(trial)
