"""Lists of modelled contacts: bounded, summed over frames without loss, read back from JSON."""

from __future__ import annotations

import json
from dataclasses import asdict

from hypothesis import given
from hypothesis import strategies as st

from dtrepair.report.parts import (
    LISTED,
    AttachedList,
    AttachedRecord,
    PairCounts,
    PartPairs,
    bounded,
    over_frames,
    summed,
)
from tests.report.part_records import part, record


def total(every: PartPairs) -> PairCounts:
    return summed([every.others.counts, *(each.counts for each in every.listed)])


def test_a_part_is_named_so_that_it_is_found_again() -> None:
    assert str(part(3)) == "/Hero/Body part 3 (412 triangles, around 0.1 1.5 0)"
    assert str(part(None)) == "/Hero/Body"


def test_a_list_is_bounded_and_its_rest_summed() -> None:
    records = [record(number, 100 - number, 1) for number in range(LISTED + 5)]
    every = bounded(records)
    assert every.listed == tuple(records[:LISTED]) and every.others.parts == 5
    assert total(every) == summed(each.counts for each in records)
    assert not PartPairs() and every
    more = bounded(records, most=LISTED + 2)
    assert more.listed == tuple(records[: LISTED + 2]) and total(more) == total(every)


@given(st.lists(st.lists(st.integers(1, 50), max_size=30), max_size=5))
def test_sums_over_frames_lose_nothing(frames: list[list[int]]) -> None:
    lists = [
        bounded([record(number, pairs) for number, pairs in enumerate(sorted(own, reverse=True))])
        for own in frames
    ]
    every = over_frames(lists)
    assert total(every) == summed([PairCounts(), *map(total, lists)])
    assert len(every.listed) <= LISTED
    pairs = [each.counts.pairs_before for each in every.listed]
    assert pairs == sorted(pairs, reverse=True)


def test_what_is_left_comes_first() -> None:
    """Of more pairs of parts than are listed as well."""
    many = [record(number, 100 - number) for number in range(LISTED + 4)]
    every = over_frames([bounded([record(LISTED + 9, 3, 2)]), bounded(many)])
    assert [each.counts.pairs_after for each in every.listed] == [2, *[0] * (LISTED - 1)]
    assert every.listed[1:] == tuple(many[: LISTED - 1]) and every.others.parts == 4 + 1


def test_the_place_is_that_of_the_frame_with_most() -> None:
    every = over_frames([bounded([record(1, 3)]), bounded([record(1, 9)]), bounded([record(1, 2)])])
    (only,) = every.listed
    assert only.counts.pairs_before == 14 and only.centre == (9.0, 0.0, 0.0)


def test_lists_are_read_back_from_json() -> None:
    every = bounded([record(number, 30, 2) for number in range(LISTED + 2)])
    assert PartPairs.from_document(json.loads(json.dumps(asdict(every)))) == every
    attached = AttachedList(
        listed=(
            AttachedRecord(
                first=part(1), second=part(None, "/A"), pairs=4, pose="frame 2", centre=(0, 1, 2)
            ),
        ),
        others=3,
        other_pairs=7,
    )
    assert AttachedList.from_document(json.loads(json.dumps(asdict(attached)))) == attached
    assert len(attached) == 4 and not AttachedList()
