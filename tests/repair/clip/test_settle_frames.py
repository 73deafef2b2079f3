"""Settling of windows: what touches nothing keeps every bit, and all stays clean."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.repair.clip.tighten_frames import SettleFramesOptions, settle_frames
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.full.settle import Settling
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import Surface
from tests.repair.full.test_settle import curled

FRAMES = 7


def window() -> tuple[WindowState, FloatArray]:
    """A tube that curls into itself and opens again, lifted off itself, and its distances (V,)."""
    rest, faces = curled(0.0)
    surface = Surface(rest, faces)
    curls = 4.6 - 0.02 * np.abs(np.arange(FRAMES) - 3.0)
    original = np.stack([curled(curl)[0] for curl in curls]) / surface.size
    frames = np.arange(FRAMES, dtype=float)

    def alone(surface: Surface, pose: FloatArray) -> FloatArray:
        return pose

    state = WindowState(surface, original, frames, WorkerPool(), alone=alone)
    assert state.dirty
    clean = np.stack([curled(4.3)[0] for _ in curls]) / surface.size
    # All of it moves a little to the side, the curl far enough to be open.
    state.work.extra[:] = clean - original + [0.0, 2e-4, 0.0]
    state.evaluate()
    assert not state.dirty
    settling = Settling(surface, original[3], state.found[3].ravel())
    return state, settling.distance / diagonal(original[3])


def test_what_is_far_keeps_every_bit_and_fades_in() -> None:
    state, distance = window()
    before = state.poses.copy()
    settle_frames(state)
    assert not state.dirty
    far = distance > 0.3
    assert far.any()
    assert np.array_equal(state.poses[:, far], state.original[:, far])
    assert (before[:, far] != state.original[:, far]).any(axis=2).all()
    near = distance < 0.02
    assert near.any() and np.allclose(state.poses[:, near], before[:, near], atol=1e-12)


def test_what_would_close_comes_back() -> None:
    state, _ = window()
    # Any strain will do: the curl would go back into itself.
    settle_frames(state, options=SettleFramesOptions(strain=100.0))
    assert not state.dirty


def test_a_carried_part_stays_where_it_was_carried() -> None:
    state, _ = window()
    before = state.poses.copy()
    settle_frames(state, options=SettleFramesOptions(strain=1e-9))
    assert np.allclose(state.poses, before, atol=1e-12)
