"""What is left, in words: made of values, of one body or of all."""

from __future__ import annotations

import json
from dataclasses import asdict

from dtrepair.diagnosis import (
    EASE,
    Advice,
    Deformation,
    Diagnosis,
    RemainingContact,
    RemainingEnclosure,
    Status,
    concerns,
    merged,
    sentence,
)

BOTH = RemainingContact("A", "B", 3, held=1)
OWN = RemainingContact("A", "A", 12)
RIGID = RemainingContact("B", "B", 2, held=2, rigid=True)
INSIDE, EYE = RemainingEnclosure("pea", "head"), RemainingEnclosure("head", "head")
FLAT = Deformation("pea", 1.3, 0.4)
LEFT = Status.IMPROVED


def test_contacts_are_named_with_their_numbers_and_what_holds_them() -> None:
    found = Diagnosis(contacts=(OWN, BOTH, RIGID), advice=(Advice.RAISE_DIFFUSION, Advice.HELD))
    assert sentence(found, LEFT) == (
        "A still intersects itself (12 pairs); "
        "A and B still intersect (3 pairs, 1 of them where nothing may move); "
        "B, which is rigid, still intersects itself (2 pairs, all of them where nothing may move): "
        f"{LEFT.meaning}: raise the diffusion; where nothing may move, nothing can be resolved"
    )


def test_few_contacts_are_named() -> None:
    every = tuple(RemainingContact(name, name, 1) for name in "ABCDE")
    found = Diagnosis(contacts=every, advice=(Advice.RAISE_DIFFUSION,))
    assert sentence(found, LEFT) == (
        "A still intersects itself (1 pair); B still intersects itself (1 pair); "
        "C still intersects itself (1 pair) and 2 more: "
        "fewer intersections, but not none: raise the diffusion"
    )


def test_other_things_that_are_left() -> None:
    assert sentence(Diagnosis(), LEFT) == LEFT.meaning and sentence(Diagnosis(), Status.CLEAN) == ""
    assert sentence(Diagnosis(too_close=2), Status.CLEAN) == "2 pairs closer than the clearance"
    of_rest = Diagnosis(contacts=(OWN,), rest_pairs=12)
    assert sentence(of_rest, LEFT) == (
        "what is left intersects in the rest pose as well (12 pairs)"
    )
    assert sentence(Diagnosis(enclosures=(INSIDE, EYE)), LEFT) == (
        "pea lies wholly inside head; a part of head lies wholly inside another part of it"
    )
    assert sentence(Diagnosis(deformations=(FLAT,)), Status.CLEAN) == (
        f"pea is clean but much deformed (lengths by a factor of 1.30, volume to 40%): {EASE}"
    )


def test_a_host_has_its_own_words_for_what_may_be_done() -> None:
    found = Diagnosis(contacts=(OWN,), advice=(Advice.RAISE_MAXIMUM_DISPLACEMENT,))
    words = {Advice.RAISE_MAXIMUM_DISPLACEMENT: "allow more"}
    assert sentence(found, LEFT, remedies=words).endswith("none: allow more")


def test_what_is_left_of_all_bodies_is_told_once() -> None:
    first = Diagnosis(contacts=(BOTH,), advice=(Advice.RAISE_DIFFUSION,), enclosures=(INSIDE,))
    second = Diagnosis(contacts=(BOTH, OWN), advice=(Advice.FREE_PINS, Advice.RAISE_DIFFUSION))
    third = Diagnosis(deformations=(FLAT,), too_close=1)
    assert merged([first, second, third, Diagnosis()]) == Diagnosis(
        contacts=(OWN, BOTH),
        advice=(Advice.RAISE_DIFFUSION, Advice.FREE_PINS),
        enclosures=(INSIDE,),
        too_close=1,
        deformations=(FLAT,),
    )
    assert merged([]) == Diagnosis() and not merged([])


def test_concerns_of_poses_that_differ_by_numbers_are_the_same() -> None:
    one = Diagnosis(contacts=(OWN, BOTH), advice=(Advice.RAISE_DIFFUSION,))
    few = tuple(RemainingContact(c.first, c.second, 1) for c in one.contacts)
    other = Diagnosis(contacts=few, advice=one.advice)
    assert (
        concerns(one, LEFT)
        == concerns(other, LEFT)
        == {
            f"{LEFT.meaning}: raise the diffusion": (
                "A still intersects itself",
                "A and B still intersect",
            )
        }
    )
    found = Diagnosis(enclosures=(INSIDE,), deformations=(FLAT,), rest_pairs=4)
    assert concerns(found, Status.CLEAN) == {
        "": ("pea lies wholly inside head", "what is left intersects in the rest pose as well"),
        EASE: ("pea is clean but much deformed",),
    }
    assert concerns(Diagnosis(too_close=3), Status.CLEAN) == {}


def test_a_diagnosis_comes_back_from_a_document() -> None:
    found = Diagnosis(
        contacts=(RIGID,), advice=(Advice.RIGID,), enclosures=(EYE,), deformations=(FLAT,)
    )
    document = json.loads(json.dumps(asdict(found)))
    assert Diagnosis.from_document(document) == found
