"""Tightening of a window: closer to the input, clean, and only what must goes back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtrepair.repair.clip.mend_frames import mend_frames
from dtrepair.repair.clip.push_frames import push_frames
from dtrepair.repair.clip.tighten_frames import TightenOptions, _around, tighten_frames
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import Surface
from tests.repair.clip.test_clip_repairer import swing


@pytest.fixture
def pushed() -> WindowState:
    """Pincers that swung through themselves, clean."""
    rest, faces, frames = swing()
    surface = Surface(rest, faces)
    times = np.arange(float(len(frames)))
    state = WindowState(surface, frames / surface.size, times, WorkerPool(), alone=solve_alone)
    push_frames(state)
    mend_frames(state)
    assert not state.dirty
    return state


def moved(state: WindowState) -> float:
    return float(np.linalg.norm(state.poses - state.original, axis=2).mean())


def test_displacements_become_smaller_and_no_frame_dirty(pushed: WindowState) -> None:
    before = moved(pushed)
    tighten_frames(pushed, 3)
    assert not pushed.dirty and moved(pushed) < 0.97 * before


def test_frames_that_cannot_be_pushed_go_back_only_around_their_contacts(
    pushed: WindowState, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, start = moved(pushed), pushed.snapshot()
    monkeypatch.setattr(pushed, "sweep", lambda *_: np.zeros_like(pushed.original))
    # The pincers are small: only displacement counts, and rings are fewer than for a character.
    options = TightenOptions(jitter_weight=0.0, back_rings=(2, 4, 8))
    tighten_frames(pushed, 1, options=options)
    assert not pushed.dirty and moved(pushed) < before
    pushed.restore(start)
    tighten_frames(pushed, 1, options=replace(options, back_rings=()))
    assert not pushed.dirty and moved(pushed) == before


def test_what_goes_back_fades_out_over_the_surface(pushed: WindowState) -> None:
    surface = pushed.surface
    pushed.pairs[15] = np.array([[0, 1]], dtype=np.int32)
    weight = _around(pushed, 15, 4)
    rings = surface.rings_from(surface.vertices_of(pushed.pairs[15]), 20)
    assert (weight[rings <= 4] == 1.0).all() and (weight[rings >= 8] == 0.0).all()
    assert ((weight > 0.0) & (weight < 1.0)).sum() == ((rings > 4) & (rings < 8)).sum() > 0
