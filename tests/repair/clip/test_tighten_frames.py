"""Tightening of a window: closer to the input, clean, and only what must goes back."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.repair.clip import tighten_frames as shot_tightening
from dtrepair.repair.clip.animation import _alone
from dtrepair.repair.clip.mend_frames import mend_frames
from dtrepair.repair.clip.tighten_frames import tighten_frames
from dtrepair.repair.clip.window_method import push
from dtrepair.repair.clip.window_state import SpaceTime
from dtrepair.repair.parallel.worker_pool import Crew
from dtrepair.repair.surface.surface import Surface
from tests.repair.clip.test_animation import swing


@pytest.fixture
def pushed() -> SpaceTime:
    """Pincers that swung through themselves, clean."""
    rest, faces, frames = swing()
    surface = Surface(rest, faces)
    times = np.arange(float(len(frames)))
    state = SpaceTime(surface, frames / surface.size, times, Crew(), alone=_alone)
    push(state)
    mend_frames(state)
    assert not state.dirty
    return state


def moved(state: SpaceTime) -> float:
    return float(np.linalg.norm(state.poses - state.original, axis=2).mean())


def test_displacements_become_smaller_and_no_frame_dirty(pushed: SpaceTime) -> None:
    before = moved(pushed)
    tighten_frames(pushed, 3)
    assert not pushed.dirty and moved(pushed) < 0.97 * before


def test_frames_that_cannot_be_pushed_go_back_only_around_their_contacts(
    pushed: SpaceTime, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, start = moved(pushed), pushed.snapshot()
    monkeypatch.setattr(pushed, "sweep", lambda *_: np.zeros_like(pushed.original))
    # The pincers are small: only displacement counts, and rings are fewer than for a character.
    monkeypatch.setattr(shot_tightening, "JITTER_WEIGHT", 0.0)
    monkeypatch.setattr(shot_tightening, "BACK_RINGS", (2, 4, 8))
    tighten_frames(pushed, 1)
    assert not pushed.dirty and moved(pushed) < before
    pushed.restore(start)
    monkeypatch.setattr(shot_tightening, "BACK_RINGS", ())
    tighten_frames(pushed, 1)
    assert not pushed.dirty and moved(pushed) == before


def test_what_goes_back_fades_out_over_the_surface(pushed: SpaceTime) -> None:
    surface = pushed.surface
    pushed.pairs[15] = np.array([[0, 1]], dtype=np.int32)
    part = shot_tightening._around(pushed, 15, 4)
    rings = surface.rings_from(surface.vertices_of(pushed.pairs[15]), 20)
    assert (part[rings <= 4] == 1.0).all() and (part[rings >= 8] == 0.0).all()
    assert ((part > 0.0) & (part < 1.0)).sum() == ((rings > 4) & (rings < 8)).sum() > 0
