"""Strain: what a repair did to a shape beyond what it is allowed to, as values with words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from dtrepair.wording import length


class StrainKind(StrEnum):
    """What was measured."""

    EDGES = "edges"
    DRIFT = "drift"
    SLIDE = "slide"
    VOLUME = "volume"
    LIMB = "limb"
    FLIPS = "flips"
    WORN = "worn"


_WORDS: Mapping[StrainKind, str] = {
    StrainKind.EDGES: "{0:.0f} edges four times longer or shorter, at most {1:.0f} may be",
    StrainKind.DRIFT: "{0} off {2}, at most {1}",
    StrainKind.SLIDE: "a twentieth of what is attached is {0} off, at most {1}",
    StrainKind.VOLUME: "volume changed by {0}, at most {1}",
    StrainKind.LIMB: "volume of a piece of a limb changed by {0}, at most {1}",
    StrainKind.FLIPS: "a patch {0} wide turned over, at most {1}",
    StrainKind.WORN: "came off what it goes round",
}
_LENGTHS = (StrainKind.DRIFT, StrainKind.SLIDE, StrainKind.FLIPS)
_SHARES = (StrainKind.VOLUME, StrainKind.LIMB)


@dataclass(frozen=True, kw_only=True)
class Strain:
    """A measure of a part of a body that is beyond its bound.

    Args:
        body: Name of the body.
        part: Which of its connected parts, 1 being that with most triangles; of what is measured
            over several parts the worst one.
        parts: How many parts the body has.
        kind: What was measured.
        value: Number that was measured; lengths over the size, volumes as fractions.
        bound: What the number may be at most.
        vertex: The vertex of the body where it is worst.
        place: Where that is in the input, in the space of the scene.
        size: What lengths are fractions of, the diagonal of the scene; None where it is not known.
        other: Name and part of what it came off, of drift; None where it is not known.
    """

    body: str
    part: int
    parts: int
    kind: StrainKind
    value: float
    bound: float
    vertex: int
    place: tuple[float, float, float]
    size: float | None = None
    other: str | None = None

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Strain:
        """Return the strain that `dataclasses.asdict` made a document of, read from JSON."""
        kind, place = StrainKind(document["kind"]), tuple(document["place"])
        return cls(**{**document, "kind": kind, "place": place})

    @property
    def where(self) -> str:
        """Say which body and part it is."""
        return part_label(self.body, self.part, self.parts)

    @property
    def measure(self) -> str:
        """Say what was measured, with the number and its bound."""
        numbers = (self.value, self.bound)
        if self.kind in _LENGTHS:
            lengths = (length(number, self.size) for number in numbers)
            return _WORDS[self.kind].format(*lengths, self.other or "what it is attached to")
        if self.kind in _SHARES:
            # What is little beyond its bound has to look so.
            near = f"{self.value:.0%}" == f"{self.bound:.0%}"
            return _WORDS[self.kind].format(*(f"{own:.{2 * near}%}" for own in numbers))
        return _WORDS[self.kind].format(*numbers)

    def __str__(self) -> str:
        """Say what was measured, and where it is worst."""
        place = ", ".join(f"{number:.4g}" for number in self.place)
        return f"{self.where}, at ({place}), vertex {self.vertex}: {self.measure}"


def part_label(body: str, part: int, parts: int) -> str:
    """Return the name of a body, and which of its parts, where it has several."""
    return f"{body}, part {part} of {parts}" if parts > 1 else body
