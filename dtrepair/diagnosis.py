"""What was counted, what a repair left, what may be done about it: values and their sentences."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from dtrepair.strain import Strain as Strain
from dtrepair.strain import StrainKind as StrainKind
from dtrepair.strain import part_label as part_label
from dtrepair.wording import counted

# So many contacts, or parts inside others, are named in a sentence.
NAMED = 3


class Status(StrEnum):
    """Outcome of one pose."""

    CLEAN = "clean"
    STRAINED = "strained"
    IMPROVED = "improved"
    UNCHANGED = "unchanged"
    FAILED = "failed"
    SKIPPED = "skipped"

    @property
    def meaning(self) -> str:
        """Say what it means for the pose; nothing where nothing needs to be done."""
        return _MEANING[self]


_MEANING = {
    Status.CLEAN: "",
    Status.STRAINED: "not resolved within the bounds of deformation",
    Status.IMPROVED: "fewer intersections, but not none",
    Status.UNCHANGED: "no pose with fewer intersections was found; the input is kept",
    Status.FAILED: "the pose could not be used; the input is kept",
    Status.SKIPPED: "",
}


@dataclass(frozen=True, kw_only=True)
class CountRecord:
    """Intersecting triangles, intersecting pairs, and the pairs between different objects.

    Contacts that were modelled are counted apart: in none of the first three numbers.
    """

    triangles: int = 0
    pairs: int = 0
    inter_pairs: int = 0
    modelled_triangles: int = 0
    modelled_pairs: int = 0


class Advice(StrEnum):
    """What a user may do about contacts that are left, or why nothing can be done."""

    RAISE_MAXIMUM_DISPLACEMENT = "raise maximum displacement"
    TAKE_FULL_METHOD = "take full method"
    TAKE_AT_ANY_COST = "take at any cost"
    RAISE_EFFORT = "raise effort"
    EASE_POSE = "ease pose"
    RAISE_DIFFUSION = "raise diffusion"
    FREE_PINS = "free pins"
    GIVE_CLEAN_REST = "give clean rest"
    CALL_ATTACHED = "call attached"
    RIGID = "rigid"
    HELD = "held"


# What to do about contacts: alternatives, in this order.
REMEDIES: Mapping[Advice, str] = {
    Advice.RAISE_MAXIMUM_DISPLACEMENT: "raise maximum_displacement",
    Advice.TAKE_FULL_METHOD: "take the method full",
    Advice.TAKE_AT_ANY_COST: "take what is strained with at_any_cost",
    Advice.RAISE_EFFORT: "raise the effort",
    Advice.EASE_POSE: "ease the pose where it is deepest",
    Advice.RAISE_DIFFUSION: "raise the diffusion",
    Advice.FREE_PINS: "free pinned vertices",
    Advice.GIVE_CLEAN_REST: "give a rest pose that does not intersect itself",
    Advice.CALL_ATTACHED: "call the parts of joints that turned attached",
}
# Why nothing can be done about some of them.
REASONS: Mapping[Advice, str] = {
    Advice.RIGID: "what is rigid cannot be resolved within itself",
    Advice.HELD: "where nothing may move, nothing can be resolved",
}


@dataclass(frozen=True)
class RemainingContact:
    """Pairs of triangles of two bodies that still intersect, or of one with itself.

    Args:
        first: Name of a body.
        second: Name of the other; the same where it intersects itself.
        pairs: How many pairs.
        held: How many of them are where nothing may move.
        rigid: Whether it is a rigid body with itself.
    """

    first: str
    second: str
    pairs: int
    held: int = 0
    rigid: bool = False

    @property
    def bodies(self) -> str:
        """Say what intersects, without numbers."""
        if self.first != self.second:
            return f"{self.first} and {self.second} still intersect"
        rigid = ", which is rigid," if self.rigid else ""
        return f"{self.first}{rigid} still intersects itself"

    def __str__(self) -> str:
        """Say what intersects, with how many pairs."""
        where = ""
        if self.held:
            share = "all" if self.held == self.pairs else str(self.held)
            where = f", {share} of them where nothing may move"
        return f"{self.bodies} ({counted(self.pairs, 'pair')}{where})"


@dataclass(frozen=True)
class RemainingEnclosure:
    """A body, or a part of it, that lies wholly inside another, or another part of the same."""

    inner: str
    outer: str

    def __str__(self) -> str:
        """Say what lies inside what."""
        if self.inner == self.outer:
            return f"a part of {self.inner} lies wholly inside another part of it"
        return f"{self.inner} lies wholly inside {self.outer}"


@dataclass(frozen=True)
class Deformation:
    """A body that is much deformed.

    Args:
        body: Its name.
        lengths: Factor by which its edges changed, the exponential of the rms log-ratio.
        volume: Its volume next to that of the input; None where that changed little or it has none.
    """

    body: str
    lengths: float
    volume: float | None = None

    @property
    def bodies(self) -> str:
        """Say what is deformed, without numbers."""
        return f"{self.body} is much deformed"

    def __str__(self) -> str:
        """Say what is deformed, and by how much."""
        volume = "" if self.volume is None else f", volume to {self.volume:.0%}"
        return f"{self.bodies} (lengths by a factor of {self.lengths:.2f}{volume})"


# What is said of pairs that were to be left alone, and what to do about a deformation.
OF_REST = "what is left intersects in the rest pose as well"
EASE = "look at it, and ease the pose where it is deepest"
# What became of strains.
LEFT_OUT = "only the share of the correction within the bounds is kept"
KEPT = "beyond the bounds, and kept all the same"


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What a repair left of a body, or of all bodies of a scene; empty where all is well.

    Args:
        contacts: Pairs that are left, those with most first.
        advice: What may be done about them, in the order of `Advice`.
        rest_pairs: How many pairs are left, where the rest pose has all of them as well and they
            were to be left alone.
        enclosures: What lies wholly inside what.
        too_close: How many pairs of a clean result are closer than the clearance.
        deformations: What is much deformed.
        strains: What is deformed beyond the bounds; what would have been, if it is advised to take
            it at any cost.
    """

    contacts: tuple[RemainingContact, ...] = ()
    advice: tuple[Advice, ...] = ()
    rest_pairs: int = 0
    enclosures: tuple[RemainingEnclosure, ...] = ()
    too_close: int = 0
    deformations: tuple[Deformation, ...] = ()
    strains: tuple[Strain, ...] = ()

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Diagnosis:
        """Return the diagnosis that `dataclasses.asdict` made a document of, read from JSON."""
        return cls(
            contacts=tuple(RemainingContact(**contact) for contact in document["contacts"]),
            advice=tuple(Advice(item) for item in document["advice"]),
            rest_pairs=document["rest_pairs"],
            enclosures=tuple(RemainingEnclosure(**inside) for inside in document["enclosures"]),
            too_close=document["too_close"],
            deformations=tuple(Deformation(**part) for part in document["deformations"]),
            strains=tuple(Strain.from_document(part) for part in document.get("strains", ())),
        )

    @property
    def left_out(self) -> bool:
        """Whether strains were left out, and only a share of the correction is kept."""
        return Advice.TAKE_AT_ANY_COST in self.advice

    def __bool__(self) -> bool:
        """Whether there is anything to tell."""
        return self != Diagnosis()


def merged(diagnoses: Iterable[Diagnosis]) -> Diagnosis:
    """Return what a repair left of all bodies, given that of each: every contact is told once."""
    found = tuple(diagnoses)
    contacts = dict.fromkeys(contact for each in found for contact in each.contacts)
    advice = {item for each in found for item in each.advice}
    enclosures = dict.fromkeys(inside for each in found for inside in each.enclosures)
    return Diagnosis(
        contacts=tuple(sorted(contacts, key=lambda contact: -contact.pairs)),
        advice=tuple(item for item in Advice if item in advice),
        rest_pairs=max((each.rest_pairs for each in found), default=0),
        enclosures=tuple(enclosures),
        too_close=max((each.too_close for each in found), default=0),
        deformations=tuple(part for each in found for part in each.deformations),
        strains=tuple(part for each in found for part in each.strains),
    )


def sentence(found: Diagnosis, status: Status, *, remedies: Mapping[Advice, str] = REMEDIES) -> str:
    """Return what a repair with a status left, in words; else what the status means.

    `remedies`: what a host calls what its user may do.
    """
    parts = []
    if found.enclosures:
        parts.append(_listed(found.enclosures))
    if found.too_close:
        parts.append(f"{counted(found.too_close, 'pair')} closer than the clearance")
    if found.rest_pairs:
        parts.append(f"{OF_REST} ({counted(found.rest_pairs, 'pair')})")
    elif found.contacts:
        what = _listed(found.contacts)
        parts.append(f"{what}: {status.meaning}: {advice_words(found.advice, remedies)}")
    if found.deformations:
        parts.append(f"{_listed(found.deformations)}: {EASE}")
    if found.strains:
        parts.append(f"{_listed(found.strains)}: {LEFT_OUT if found.left_out else KEPT}")
    return "; ".join(parts) or status.meaning


def concerns(
    found: Diagnosis, status: Status, *, remedies: Mapping[Advice, str] = REMEDIES
) -> dict[str, tuple[str, ...]]:
    """Return what concerns a user, without numbers: what may be done, and the objects it is for.

    Poses that differ by numbers only have the same concerns.
    """
    result: dict[str, tuple[str, ...]] = {}
    if found.enclosures:
        result[""] = tuple(map(str, found.enclosures))
    if found.rest_pairs:
        result[""] = (*result.get("", ()), OF_REST)
    elif found.contacts:
        words = f"{status.meaning}: {advice_words(found.advice, remedies)}"
        result[words] = tuple(contact.bodies for contact in found.contacts)
    if found.deformations:
        result[EASE] = tuple(deformation.bodies for deformation in found.deformations)
    return result


def advice_words(advice: Iterable[Advice], remedies: Mapping[Advice, str] = REMEDIES) -> str:
    """Return what may be done, as alternatives, and why nothing can be done about the rest."""
    given = set(advice)
    ways = [words for item, words in remedies.items() if item in given]
    reasons = [words for item, words in REASONS.items() if item in given]
    return "; ".join([*([", or ".join(ways)] if ways else []), *reasons])


def _listed(items: Sequence[object]) -> str:
    """Return the first few items as a list in words."""
    more = f" and {len(items) - NAMED} more" if len(items) > NAMED else ""
    return "; ".join(map(str, items[:NAMED])) + more
