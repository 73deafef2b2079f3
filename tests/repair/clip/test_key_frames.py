"""Windows whose contacts stay are solved at keys first, and move between them as the keys do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.metrics import jitter
from dtrepair.repair.clip import window_method
from dtrepair.repair.clip.push_frames import KeyWindowOptions, between_keys, keys_of
from dtrepair.repair.clip.window_method import WindowMethod, WindowOptions
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import Surface
from tests.repair.clip.test_clip_repairer import swing

FRAMES = 13
NEVER, ALWAYS = KeyWindowOptions(frames=10**6), KeyWindowOptions(frames=FRAMES)


def closed(frames: int = FRAMES) -> tuple[Surface, FloatArray]:
    """Pincers that are through themselves in all frames, now more, now less."""
    rest, faces, poses = swing()
    surface = Surface(rest, faces)
    deepest = int(np.argmax([len(surface.contacts.pairs(pose / surface.size)) for pose in poses]))
    shares = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, frames))
    first, second = poses[deepest - 2] / surface.size, poses[deepest] / surface.size
    return surface, np.stack([(1.0 - own) * first + own * second for own in shares])


def repaired(
    surface: Surface, poses: FloatArray, keys: KeyWindowOptions, *, farthest: float | None = None
) -> FloatArray:
    options = WindowOptions(keys=keys)
    method = WindowMethod(surface, solve_alone, farthest=farthest, options=options)
    found = method(poses, np.arange(float(len(poses))), WorkerPool())
    assert found is not None
    return found


def test_a_window_in_contact_is_clean_and_as_steady_by_its_keys(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    surface, poses = closed()
    led: list[int] = []

    def told(
        original: FloatArray, times: FloatArray, keys: list[int], solved: FloatArray
    ) -> FloatArray:
        led.append(len(keys))
        return between_keys(original, times, keys, solved)

    monkeypatch.setattr(window_method, "between_keys", told)
    usual, found = (repaired(surface, poses, keys) for keys in (NEVER, ALWAYS))
    assert led == [5]
    for own in (usual, found):
        assert not any(len(surface.contacts.pairs(pose)) for pose in own)
    assert jitter(poses, found) < 1.2 * jitter(poses, usual)
    moved, before = (np.mean(lengths(own - poses)) for own in (found, usual))
    assert moved < 1.2 * before


def test_what_comes_and_goes_is_solved_as_before() -> None:
    surface, poses = closed()
    poses[:5] = surface.rest
    usual = repaired(surface, poses, NEVER)
    assert np.array_equal(repaired(surface, poses, ALWAYS), usual)
    # A share that these keys do have: another result.
    assert not np.array_equal(repaired(surface, poses, replace(ALWAYS, share=0.1)), usual)


def test_what_may_not_move_far_is_solved_as_before() -> None:
    """Between keys a vertex may go farther than at both of them."""
    surface, poses = closed()
    usual, found = (repaired(surface, poses, keys, farthest=0.01) for keys in (NEVER, ALWAYS))
    assert np.array_equal(found, usual)


@pytest.mark.parametrize("call", [1, 3])
def test_where_pushing_is_stuck_the_window_is_solved_as_before(
    call: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked after the push of the keys, before they are mended, and after that of all frames."""
    surface, poses = closed()
    usual, asked = repaired(surface, poses, NEVER), list[None]()

    def stuck(*_: object, **__: object) -> bool:
        asked.append(None)
        return len(asked) == call

    monkeypatch.setattr(window_method, "is_stuck", stuck)
    assert np.array_equal(repaired(surface, poses, ALWAYS), usual) and len(asked) == call + 1


@given(st.integers(2, 40), st.integers(1, 6))
def test_keys_are_evenly_spaced_with_both_ends(count: int, stride: int) -> None:
    keys = keys_of(count, KeyWindowOptions(stride=stride))
    assert keys[0] == 0 and keys[-1] == count - 1
    assert keys == sorted(set(keys)) and max(np.diff(keys)) <= stride


def test_between_keys_moves_as_they_do_and_still_vertices_keep_their_bits() -> None:
    rng, times = np.random.default_rng(2), np.array([0.0, 1.0, 2.0, 3.5, 5.0, 6.0, 7.0])
    original, keys = rng.normal(size=(7, 9, 3)), [0, 3, 6]
    moved = times[:, None, None] ** 2 * rng.normal(size=(9, 3))
    moved[:, :4] = 0.0
    moved[keys[1], 3] = 1.0
    found = between_keys(original, times, keys, (original + moved)[keys])
    assert np.array_equal(found[keys], (original + moved)[keys])
    assert np.array_equal(found[:, :3], original[:, :3])
    assert np.allclose(found[:, 4:], (original + moved)[:, 4:], atol=1e-12)
    assert (found[1:3, 3] != original[1:3, 3]).all()
