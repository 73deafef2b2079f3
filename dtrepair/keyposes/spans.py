"""Spans between keys, and what was found in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple, Protocol

from dtrepair.keyposes.tracks import Pose, Track


class Solver(Protocol):
    """What a scene can answer about poses (V, 3) float32, one for each mesh."""

    @property
    def ways(self) -> Sequence[int]:
        """Numbers of the ways to repair a pose, that which stays nearest to it first."""

    def pairs(self, time: float, poses: Sequence[Pose]) -> int:
        """Return the number of intersecting pairs, exactly."""

    def repair(self, time: float, poses: Sequence[Pose], way: int) -> tuple[Pose, ...] | None:
        """Return poses with fewer pairs; None where there are none."""

    def allowed(self, index: int, time: float, given: Pose, pose: Pose) -> Pose:
        """Return the nearest pose that a mesh may have instead of `given`."""


class Sample(NamedTuple):
    """An in-between and its intersecting pairs."""

    time: float
    pairs: int


@dataclass(frozen=True)
class Span:
    """The samples between two given keys: before, and after with the times of added keys."""

    start: float
    end: float
    before: tuple[Sample, ...]
    after: tuple[Sample, ...]
    added: tuple[float, ...] = ()


@dataclass(frozen=True)
class KeyPoses:
    """Tracks, one for each mesh, and the spans between the keys of all of them."""

    tracks: tuple[Track, ...]
    spans: tuple[Span, ...]


@dataclass(frozen=True, eq=False)
class Trial:
    """The state after a change; whether it is all that is needed, and how much the cost fell."""

    tracks: tuple[Track, ...]
    added: tuple[float, ...]
    known: dict[tuple[float, float], tuple[Sample, ...]]
    solved: bool
    gain: float


def parts_of(span: tuple[float, float], added: Sequence[float]) -> list[tuple[float, float]]:
    """Return a span split at the keys that were added in it."""
    start, end = span
    times = [start, *sorted(time for time in added if start < time < end), end]
    return list(pairwise(times))


def cost_of(part: tuple[float, float], samples: Sequence[Sample]) -> float:
    """Return pairs integrated over time, so that finer samples cost no more."""
    return (part[1] - part[0]) * sum(sample.pairs for sample in samples) / len(samples)


def places_for(samples: Sequence[Sample]) -> list[float]:
    """Return where a key may help: amid samples that are not clean, and at the worst."""
    dirty = [sample for sample in samples if sample.pairs]
    worst = max(dirty, key=lambda sample: sample.pairs).time
    return list(dict.fromkeys([0.5 * (dirty[0].time + dirty[-1].time), worst]))
