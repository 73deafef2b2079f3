"""Shares of a correction: within the bounds, most of it, smooth over the surface and in time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.repair.strain.bounds import StrainOptions
from dtrepair.repair.strain.meter import StrainMeter
from dtrepair.repair.strain.parts import ConnectedParts
from dtrepair.repair.strain.shares import ShareOptions, ShareSearch, eased_shares, followed_shares
from tests.meshes import icosphere, joined, tube

POINTS, FACES = tube(12, 60, 0.2, 6.0)
PARTS = ConnectedParts(FACES, np.zeros(len(POINTS), dtype=np.int32))
METER = StrainMeter(PARTS)
Z = POINTS[:, 2] - POINTS[:, 2].min()


def blend(before: FloatArray, after: FloatArray) -> Callable[[FloatArray], FloatArray]:
    def pose(share: FloatArray) -> FloatArray:
        mixed: FloatArray = before + share[:, None] * (after - before)
        return mixed

    return pose


def search(after: FloatArray, **values: Any) -> ShareSearch:
    options = ShareOptions(**values)
    return ShareSearch(METER, POINTS, after, blend(POINTS, after), options=options)


def spoilt(side: float = 0.0) -> FloatArray:
    """The tube bent a little along all its length, and crushed in the middle."""
    after: FloatArray = POINTS + 0.05 * np.sin(Z)[:, None] * [1.0, 0.0, 0.0]
    crushed = np.abs(Z - 3.0) < 0.4
    after[crushed] *= [0.02, 0.02, 1.0]
    after[crushed, 0] += side
    return after


def test_shares_keep_the_bounds_and_what_is_fine_keeps_all() -> None:
    after = spoilt()
    assert METER(POINTS, after)
    share = next(search(after).shares())
    assert METER(POINTS, blend(POINTS, after)(share)) == []
    assert (share[(Z < 1.5) | (Z > 4.5)] == 1.0).all()
    assert 0.0 < share.min() < 1.0 and share[np.abs(Z - 3.0) < 0.4].max() < 1.0


@pytest.mark.parametrize(("beyond", "lost"), [(1.005, 0.021), (1.1, 0.14), (3.0, 0.25)])
def test_what_is_hardly_beyond_its_bound_gives_up_hardly_anything(
    beyond: float, lost: float
) -> None:
    """A ball that swells by a little more than a fifth, and by more."""
    points, faces = icosphere(3)
    meter = StrainMeter(ConnectedParts(faces, np.zeros(len(points), dtype=np.int32)))
    after = points * (1.0 + meter.options.volume * beyond) ** (1.0 / 3.0)
    assert meter(points, after)
    found = ShareSearch(meter, points, after, blend(points, after))
    share = next(found.shares())
    assert meter(points, blend(points, after)(share)) == []
    assert 1.0 - share.min() <= lost if beyond < 2.0 else 1.0 - share.min() > 0.5
    # Steps that are too small to end are followed by whole ones.
    small = ShareOptions(more=0.0, least=1e-4)
    whole = ShareSearch(meter, points, after, blend(points, after), options=small)
    assert next(whole.shares()).min() == pytest.approx(0.75 if beyond < 2.0 else 0.25)


def test_a_share_is_smooth_over_the_surface() -> None:
    share = next(search(spoilt(side=0.3)).shares())
    steps = np.abs(share[PARTS.edges[:, 0]] - share[PARTS.edges[:, 1]])
    # It comes back over three times the longest motion, 0.5, and edges are 0.1 long.
    assert steps.max() < 0.3 and len(np.unique(share)) > 5


def test_everything_that_can_be_yielded_keeps_the_bounds() -> None:
    after = spoilt(side=0.3)
    shares = list(search(after).shares())
    assert len(shares) >= 3
    for share in shares:
        assert METER(POINTS, blend(POINTS, after)(share)) == []
        assert share.shape == Z.shape and (share >= 0.0).all() and (share <= 1.0).all()
    put_back, uniform = shares[-2:]
    assert (put_back[np.abs(Z - 3.0) < 0.3] == 0.0).all() and put_back.max() == 1.0
    assert len(np.unique(uniform)) == 1


def test_steep_shares_are_yielded_after_the_wide_one_and_give_up_less() -> None:
    after = spoilt(side=0.3)
    wide, *steep = list(search(after).shares())[:3]
    given_up = [float((1.0 - share).sum()) for share in (wide, *steep)]
    assert given_up[0] > given_up[1] > given_up[2] > 0.0
    assert len(list(search(after, steep=()).shares())) == len(list(search(after).shares())) - 2


def test_where_no_round_is_left_all_of_it_is_given_up_alike() -> None:
    share = next(search(spoilt(), rounds=1).shares())
    assert len(np.unique(share)) == 1 and share[0] < 1.0
    never = StrainMeter(PARTS, options=StrainOptions(factor=1.0 + 1e-9, edges=0))
    after = spoilt()
    found = ShareSearch(never, POINTS, after, blend(POINTS, after)).uniform()
    assert (found == 0.0).all()


def test_a_finer_step_gives_up_less() -> None:
    coarse, fine = (
        next(search(spoilt(), step=step, rounds=30).shares()).min() for step in (0.5, 0.05)
    )
    assert coarse <= fine


def test_what_is_attached_is_lowered_along() -> None:
    mesh = joined(icosphere(3), (0.2 * icosphere(2)[0] + [0.0, 0.0, 1.05], icosphere(2)[1]))
    points, faces = mesh
    reference = Reference(points, Detector(points, faces)(points))
    attachments = find_attachments(faces, len(points), [reference])
    parts = ConnectedParts(faces, np.zeros(len(points), dtype=np.int32), attachments)
    meter = StrainMeter(parts)
    after = points.copy()
    eye = parts.of_vertex == 1
    after[eye, 0] += 0.04 * diagonal(points)
    after[~eye, 1] += 0.01 * np.cos(points[~eye, 1])
    assert meter(points, after)
    share = next(ShareSearch(meter, points, after, blend(points, after)).shares())
    assert meter(points, blend(points, after)(share)) == []
    near = ~eye & (points[:, 2] > 0.95)
    assert share[eye].max() < 1.0 and share[near].max() < 1.0
    assert (share[points[:, 2] < 0.0] == 1.0).all()


FRAMES = np.arange(30.0)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=30, max_size=30),
    st.floats(0.5, 3.0),
    st.floats(0.0, 0.1),
)
def test_eased_shares_are_never_above_those_that_are_needed(
    values: list[float], width: float, motion: float
) -> None:
    shares = np.stack([np.array(values), np.ones(30)], axis=1)
    options = ShareOptions(time=width)
    eased = eased_shares(shares, FRAMES, np.full_like(shares, motion), options=options)
    assert (eased <= shares + 1e-12).all() and (eased >= 0.0).all() and (eased[:, 1] == 1.0).all()


def eased_frame(motion: float) -> FloatArray:
    """Shares of one vertex over 30 frames, of which one is lowered to 0."""
    shares = np.ones((30, 1))
    shares[15] = 0.0
    motions = np.full_like(shares, motion)
    return eased_shares(shares, FRAMES, motions, options=ShareOptions(time=1.5))[:, 0]


def test_a_lone_frame_comes_and_goes_within_some_frames() -> None:
    eased = eased_frame(1e9)
    assert eased[15] == 0.0 and (np.delete(eased, np.arange(7, 24)) == 1.0).all()
    assert np.abs(np.diff(eased)).max() < 0.4 and (np.diff(eased[15:]) >= 0.0).all()
    assert eased[1:15] == pytest.approx(eased[29:15:-1])


def test_frames_beside_keep_motions_that_are_not_seen() -> None:
    unseen = ShareOptions().unseen
    eased = eased_frame(unseen)
    assert eased[15] == 0.0 and (np.delete(eased, 15) == 1.0).all()
    # What is given up beside the frame grows from nothing with the motion.
    assert eased_frame(1.01 * unseen)[14] > 0.98 > eased_frame(3.0 * unseen)[14]


def bump(*peaks: int) -> FloatArray:
    """Motions (30, 1) that ease into peaks."""
    away = (FRAMES[:, None] - np.array(peaks)) / 4.0
    peaked: FloatArray = np.exp(-0.5 * away**2).sum(axis=1, keepdims=True)
    return peaked


def followed(shares: FloatArray, motions: FloatArray, *faulty: int) -> FloatArray:
    mask = np.isin(FRAMES, faulty)
    return followed_shares(shares, FRAMES, motions, mask)


@pytest.mark.parametrize("kept", [0.0, 0.25])
def test_frames_without_a_fault_give_up_what_the_faulty_one_does(kept: float) -> None:
    shares = np.ones((30, 2))
    shares[15, 0] = kept
    motions = np.repeat(bump(15), 2, axis=1)
    found = followed(shares, motions, 15)
    assert found[15, 0] == kept and (found[:, 1] == 1.0).all()
    # They need not move less than what is kept lets expect.
    moved = found[:, 0] * motions[:, 0]
    expected = kept * np.exp(-0.5 * ((FRAMES - 15.0) / ShareOptions().follow) ** 2)
    assert moved == pytest.approx(np.maximum(kept * motions[:, 0], expected))


def test_frames_between_follow_the_nearer_one() -> None:
    shares = np.ones((30, 1))
    shares[8] = 0.0
    found = followed(shares, bump(8, 22), 8, 22)[:, 0]
    assert found[8] == 0.0 and found[:6].max() < 1e-6 and found[23:] == pytest.approx(1.0)
    assert (np.diff(found[8:23]) >= 0.0).all() and np.diff(found[8:22]).max() < 0.5


def test_frames_with_faults_or_without_such_neighbours_keep_their_shares() -> None:
    shares = np.linspace(0.2, 1.0, 30)[:, None]
    assert np.array_equal(followed(shares, bump(15)), shares)
    assert np.array_equal(followed(shares, bump(15), *range(30)), shares)
    motions = bump(15)
    motions[15] = 0.0  # what does not move there is nothing that could be given up
    assert np.array_equal(followed(shares, motions, 15), shares)
    motions[15] = 1e-17  # nor is what rounding moves
    lowered = np.where(FRAMES == 15, 0.0, 1.0)[:, None]
    assert np.array_equal(followed(lowered, motions, 15), lowered)


@given(st.lists(st.floats(0.0, 1.0), min_size=30, max_size=30), st.sets(st.integers(0, 29)))
def test_followed_shares_are_never_above_those_that_are_given(
    values: list[float], faulty: set[int]
) -> None:
    shares = np.array(values)[:, None]
    found = followed(shares, bump(3, 20), *faulty)
    assert (found <= shares).all() and (found >= 0.0).all()
    assert np.array_equal(found[sorted(faulty)], shares[sorted(faulty)])
