"""The frames of a window know their pairs, whatever moved since they were found."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.temporal import gaussian_kernel
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.frame.frame_options import FrameOptions
from tests.repair.clip.test_settle_frames import window


def assert_pairs_are_those_of_the_poses(state: WindowState) -> None:
    for pose, pairs in zip(state.poses, state.pairs, strict=True):
        assert np.array_equal(pairs, state.surface.contacts.pairs(pose))


def test_pairs_are_found_where_a_part_moved() -> None:
    state, distance = window()
    random = np.random.default_rng(2)
    clean, met = state.work.extra.copy(), 0
    for share in (0.02, 0.1, 0.3, 1.0, 0.0):
        # What is near the contact goes back towards the input, shaken, the rest stays.
        part = (distance <= np.quantile(distance, share)) & (share > 0.0)
        shaken = random.normal(scale=1e-3, size=clean.shape) * part[:, None]
        state.work.extra[:] = np.where(part[:, None], 0.3 * clean, clean) + shaken
        state.evaluate()
        assert_pairs_are_those_of_the_poses(state)
        met += state.remaining
    assert met > 0 and not state.dirty


def test_pairs_after_sweeps_are_those_of_the_poses() -> None:
    state, _ = window()
    state.work.extra[:] = 0.0
    state.evaluate()
    left = [state.remaining]
    for _ in range(4):
        state.sweep(gaussian_kernel(state.frames, 1.5), 0.004)
        assert_pairs_are_those_of_the_poses(state)
        left.append(state.remaining)
    assert 0 < left[1] != left[0]


def test_what_hardly_moved_keeps_its_pairs() -> None:
    state, _ = window()
    state.work.extra[:] = 0.0
    state.evaluate()
    before = [pairs.copy() for pairs in state.pairs]
    state.work.extra[:] = 0.5 * FrameOptions().stale
    state.evaluate()
    assert all(map(np.array_equal, before, state.pairs))
