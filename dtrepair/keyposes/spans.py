"""Spans between keys, and what was found in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from dtrepair.keyposes.tracks import Pose, Track


class Solver(Protocol):
    """What a scene can answer about poses (V, 3) float32, one for each mesh."""

    def pairs(self, time: float, poses: Sequence[Pose]) -> int:
        """Return the number of intersecting pairs, exactly."""

    def repair(self, time: float, poses: Sequence[Pose]) -> tuple[Pose, ...] | None:
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
