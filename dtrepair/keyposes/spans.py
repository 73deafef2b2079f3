"""Spans between keys, what was found in them, and how they are looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from dtrepair.keyposes.tracks import INTERPOLATIONS, Pose, Track


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


@dataclass(frozen=True)
class KeyOptions:
    """How in-betweens are looked at and mended.

    samples: looked at between two keys, evenly; extra: most keys added between two given ones;
    keep_keys: given keys are not moved; interpolation: of "linear", "cubic"; jobs: threads.
    """

    samples: int = 4
    extra: int = 8
    keep_keys: bool = False
    interpolation: str = "linear"
    jobs: int = 1

    def __post_init__(self) -> None:
        """Check the choices."""
        for name, least in (("samples", 1), ("extra", 0), ("jobs", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} should be at least {least}, got {getattr(self, name)}")
        if self.interpolation not in INTERPOLATIONS:
            raise ValueError(
                f"interpolation should be one of {', '.join(INTERPOLATIONS)}, "
                f"got {self.interpolation!r}"
            )
