"""Contact events: patches of a frame, followed from frame to frame."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.contact_events import FramePairs, contact_events

# A strip of triangles: number k has the vertices k, k + 1 and k + 2.
FACES = np.stack([np.arange(40), np.arange(1, 41), np.arange(2, 42)], axis=1).astype(np.int32)


def pairs(*rows: tuple[int, int]) -> NDArray[np.int32]:
    return np.array(rows, dtype=np.int32).reshape(-1, 2)


def before(*rows: tuple[int, int]) -> FramePairs:
    return FramePairs(before=pairs(*rows))


def test_two_places_are_two_events_and_the_larger_is_first() -> None:
    events = contact_events({0: before((0, 10), (1, 10), (30, 39))}, FACES)
    assert [event.before[0].tolist() for event in events] == [[0, 1, 10], [30, 39]]
    assert events[0].frames == (0,) and events[0].worst == 0


def test_a_contact_is_followed_while_it_moves_and_grows() -> None:
    moving = {k: before((k, 20 + k), *[(k + 1, 20 + k)] * (k == 2)) for k in range(4)}
    (event,) = contact_events(moving, FACES)
    assert event.frames == (0, 1, 2, 3)
    assert event.worst == 2 and event.count(2, "before") == 3


@pytest.mark.parametrize(("gap", "count"), [(3, 1), (2, 2)])
def test_a_few_frames_without_it_do_not_end_it(gap: int, count: int) -> None:
    events = contact_events({0: before((0, 10)), 3: before((0, 10))}, FACES, gap=gap)
    assert len(events) == count


def test_patches_that_grow_together_go_on_as_the_one_with_more_in_common() -> None:
    apart = before((0, 10), (1, 11), (2, 12), (30, 39))
    together = before((0, 10), (1, 11), (2, 12), (12, 30), (30, 39))
    large, small = contact_events({0: apart, 1: together}, FACES)
    assert large.frames == (0, 1) and small.frames == (0,)


def test_what_a_repair_left_comes_first_and_is_the_worst_frame() -> None:
    frames = {
        0: before((0, 10), (1, 11), (2, 12)),
        1: FramePairs(pairs((30, 39)), pairs((30, 39))),
        2: before((30, 39), (29, 39)),
    }
    left, resolved = contact_events(frames, FACES)
    assert left.worst == 1 and left.count(1, "after") == 2
    assert left.frames == (1, 2) and resolved.frames == (0,)


def test_nothing_is_no_event() -> None:
    assert contact_events({}, FACES) == []
    assert contact_events({3: FramePairs()}, FACES) == []
