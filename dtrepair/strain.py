"""Strain: what a repair did to a shape beyond what it is allowed to, as values with words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class StrainKind(StrEnum):
    """What was measured."""

    EDGES = "edges"
    DRIFT = "drift"
    SLIDE = "slide"
    VOLUME = "volume"
    FLIPS = "flips"


_WORDS: Mapping[StrainKind, str] = {
    StrainKind.EDGES: "{0:.0f} edges four times longer or shorter, at most {1:.0f} may be",
    StrainKind.DRIFT: "{0:.3f} of the diagonal off what it is attached to, at most {1:.3f}",
    StrainKind.SLIDE: "a twentieth of what is attached is {0:.4f} of the diagonal off, "
    "at most {1:.4f}",
    StrainKind.VOLUME: "volume changed by {0:.0%}, at most {1:.0%}",
    StrainKind.FLIPS: "a patch of {0:.3f} of the diagonal turned over, at most {1:.3f}",
}


@dataclass(frozen=True, kw_only=True)
class Strain:
    """A measure of a part of a body that is beyond its bound.

    Args:
        body: Name of the body.
        part: Which of its connected parts, 1 being that with most triangles; of what is measured
            over several parts the worst one.
        parts: How many parts the body has.
        kind: What was measured.
        value: Number that was measured; lengths over the diagonal, volumes as fractions.
        bound: What the number may be at most.
        vertex: The vertex of the body where it is worst.
        place: Where that is in the input, in the space of the scene.
    """

    body: str
    part: int
    parts: int
    kind: StrainKind
    value: float
    bound: float
    vertex: int
    place: tuple[float, float, float]

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Strain:
        """Return the strain that `dataclasses.asdict` made a document of, read from JSON."""
        kind, place = StrainKind(document["kind"]), tuple(document["place"])
        return cls(**{**document, "kind": kind, "place": place})

    @property
    def where(self) -> str:
        """Say which body and part it is."""
        return f"{self.body}, part {self.part} of {self.parts}" if self.parts > 1 else self.body

    @property
    def measure(self) -> str:
        """Say what was measured, with the number and its bound."""
        return _WORDS[self.kind].format(self.value, self.bound)

    def __str__(self) -> str:
        """Say what was measured, and where it is worst."""
        place = ", ".join(f"{number:.4g}" for number in self.place)
        return f"{self.where}, at ({place}), vertex {self.vertex}: {self.measure}"
