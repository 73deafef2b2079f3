"""What is left, in words: made of values, of one body or of all."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

from dtrepair.diagnosis import (
    EASE,
    KEPT,
    LEFT_OUT,
    Advice,
    Deformation,
    Diagnosis,
    RemainingContact,
    RemainingEnclosure,
    Status,
    Strain,
    StrainKind,
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
CRUSHED = Strain(
    body="hero",
    part=3,
    parts=60,
    kind=StrainKind.EDGES,
    value=120.0,
    bound=7.0,
    vertex=41,
    place=(0.5, -1.25, 3.0),
)


def test_lengths_of_strains_are_told_in_units_and_in_per_cent_of_the_size() -> None:
    loose = replace(CRUSHED, kind=StrainKind.DRIFT, value=0.031, bound=0.02)
    assert loose.measure == "3.1 % of the size off what it is attached to, at most 2 % of the size"
    sized = replace(loose, size=180.0)
    assert sized.measure == "5.58 (3.1 %) off what it is attached to, at most 3.6 (2 %)"
    known = replace(sized, other="/Hero/Vest, part 2 of 3")
    assert known.measure == "5.58 (3.1 %) off /Hero/Vest, part 2 of 3, at most 3.6 (2 %)"
    turned = replace(sized, kind=StrainKind.FLIPS)
    assert turned.measure == "a patch 5.58 (3.1 %) wide turned over, at most 3.6 (2 %)"
    assert replace(CRUSHED, size=180.0).measure == CRUSHED.measure


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
        f"pea is much deformed (lengths by a factor of 1.30, volume to 40%): {EASE}"
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
        EASE: ("pea is much deformed",),
    }
    assert concerns(Diagnosis(too_close=3), Status.CLEAN) == {}


def test_strains_are_told_with_part_place_number_and_bound() -> None:
    words = (
        "hero, part 3 of 60, at (0.5, -1.25, 3), vertex 41: "
        "120 edges four times longer or shorter, at most 7 may be"
    )
    assert str(CRUSHED) == words
    assert sentence(Diagnosis(strains=(CRUSHED,)), Status.STRAINED) == f"{words}: {KEPT}"
    told = [str(replace(CRUSHED, kind=kind, value=0.5, bound=0.02)) for kind in StrainKind]
    bounded = [each for each in told if "at most" in each]
    assert len(set(told)) == len(StrainKind) == len(bounded) + 1
    (worn,) = set(told) - set(bounded)
    assert worn.endswith(": came off what it goes round")
    assert replace(CRUSHED, parts=1).where == "hero"


def test_a_contact_that_is_left_hides_no_other_message() -> None:
    found = Diagnosis(
        contacts=(OWN,),
        advice=(Advice.TAKE_AT_ANY_COST, Advice.RAISE_DIFFUSION),
        enclosures=(INSIDE,),
        too_close=2,
        deformations=(FLAT,),
        strains=(CRUSHED,),
    )
    told = sentence(found, Status.STRAINED)
    for part in (str(OWN), str(INSIDE), "2 pairs closer", str(FLAT), f"{CRUSHED}: {LEFT_OUT}"):
        assert part in told
    assert f"{Status.STRAINED.meaning}: take what is strained with at_any_cost, or raise" in told
    assert merged([found, Diagnosis()]).strains == (CRUSHED,) and found.left_out


def test_a_diagnosis_comes_back_from_a_document() -> None:
    found = Diagnosis(
        contacts=(RIGID,),
        advice=(Advice.RIGID,),
        enclosures=(EYE,),
        deformations=(FLAT,),
        strains=(CRUSHED,),
    )
    document = json.loads(json.dumps(asdict(found)))
    assert Diagnosis.from_document(document) == found
    del document["strains"]  # as older reports are
    assert Diagnosis.from_document(document) == replace(found, strains=())
