"""Deep contacts in clips: clean, steady, and nothing moves that is far from them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Repairer, RepairOptions, Status
from dtrepair.demo.character import make_character
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import displacements, jitter
from dtrepair.numerics.temporal import second_differences, steady_weights
from dtrepair.repair.clip.window_method import EaseOptions, WindowMethod, WindowOptions
from dtrepair.repair.full.mend import mend
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import Surface
from tests.repair.clip.test_clip_repairer import crossings, pincers, results_of, roughness, swing

Clip = tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]


@pytest.fixture
def embrace() -> Clip:
    """Rest, faces and frames (T, V, 3) of a character that drives its forearms into its body."""
    turns = {
        "left_arm": (62, -14, -55),
        "right_arm": (58, 14, 50),
        "left_forearm": (0, -112, 0),
        "right_forearm": (0, 112, 0),
    }
    character = make_character(16, turns=turns)
    quads = character.quads
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    # Written clips hold single precision.
    return character.rest, faces, character.points.astype(np.float32).astype(np.float64)


def test_forearms_through_the_body_come_out_clean_and_steady(embrace: Clip) -> None:
    rest, faces, frames = embrace
    results = Repairer(rest, faces).animation(frames)
    repaired = np.stack([result.points for result in results])
    assert max(result.before.triangles for result in results) > 250
    assert all(result.status is Status.CLEAN for result in results if result.before.triangles)
    assert all(result.after.triangles == 0 for result in results)
    assert jitter(frames, repaired) < 4e-3
    moved = [displacements(a, b).mean() for a, b in zip(frames, repaired, strict=True)]
    assert np.mean(moved) < 0.015
    # The body gives way as far as the knees; the feet and the head keep every bit.
    far = (rest[:, 1] < 0.1) | (rest[:, 1] > 1.65)
    assert far.sum() > 500 and (repaired[:, far] == frames[:, far]).all()


def test_frames_far_in_time_keep_every_bit_in_a_clip_of_several_windows() -> None:
    rest, faces, middle = swing()
    # The arms swing through each other in the middle third; before and after only they move.
    sway = 0.3 * np.sin(np.linspace(0.0, 3.0, 30))
    before, after = (
        np.stack([pincers(0.4 + part)[0] for part in parts]) for parts in (sway, sway[::-1])
    )
    frames = np.concatenate([before[:-1], middle, after[1:]])
    assert len(frames) > 60  # more than a window
    repaired = results_of(Repairer(rest, faces), frames)
    dirty = np.flatnonzero(crossings(rest, faces, frames))
    assert len(dirty) >= 5 and 29 < dirty[0] and dirty[-1] < 59
    assert sum(crossings(rest, faces, repaired)) == 0
    away = np.abs(np.arange(len(frames))[:, None] - dirty).min(axis=1)
    kept = (repaired == frames).all(axis=2)
    # The kernel ends at 3 sigma = 10.5 frames.
    assert (away > 10).sum() > 50 and kept[away > 10].all()
    assert not kept[dirty].all(axis=1).any()


def test_taken_out_displacements_come_back_where_they_are_needed() -> None:
    rest, faces, frames = swing()
    surface, times = Surface(rest, faces), np.arange(20.0)
    original = frames[5:25] / surface.size

    def repaired(still: float) -> FloatArray:
        options = WindowOptions(ease=EaseOptions(still=still))
        poses = WindowMethod(surface, solve_alone, options=options)(original, times, WorkerPool())
        assert poses is not None
        return poses

    few, every = repaired(0.02), repaired(1e-9)
    assert all(len(surface.contacts.pairs(pose)) == 0 for pose in few)
    assert (few == original).mean() > (every == original).mean()


def test_mended_poses_change_as_little_as_the_starts_allow() -> None:
    rest, faces, frames = swing()
    surface = Surface(rest, faces)
    clean, dirty = frames[0] / surface.size, frames[15] / surface.size
    assert (mend(surface, dirty, [clean, dirty], step=0.004) == clean).all()
    mended = mend(surface, dirty, [dirty, clean], step=0.004)
    assert len(surface.contacts.pairs(dirty)) > 0 == len(surface.contacts.pairs(mended))
    assert np.linalg.norm(mended - dirty) < np.linalg.norm(clean - dirty)


def test_the_last_resort_starts_from_the_input() -> None:
    rest, faces, frames = swing()
    surface = Surface(rest, faces)
    flat = frames[15] / surface.size
    flat[:, 1:] = 0.0
    asked = []

    def alone(_surface: Surface, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        asked.append(pose)
        return surface.rest

    result = mend(surface, flat, [flat], step=0.004, alone=alone)
    assert (asked[0] == flat).all() and (result == surface.rest).all()


def test_second_differences_are_accelerations_at_uneven_times() -> None:
    times = np.array([0.0, 1.0, 1.5, 4.0, 5.0])
    differences = second_differences(times)
    assert np.allclose(differences @ (3.0 * times - 2.0), 0.0)
    assert np.allclose(differences @ times**2, 2.0)
    assert second_differences(times[:2]).shape == (0, 2)


def test_steady_weights_keep_straight_motion_and_minimise_acceleration() -> None:
    times = np.array([0.0, 1.0, 1.5, 4.0, 5.0, 6.0])
    weights, differences = steady_weights(times), second_differences(times)
    assert (np.diag(weights) == 0.0).all()
    assert np.allclose(weights @ (3.0 * times - 2.0), 3.0 * times - 2.0)
    field = np.random.default_rng(3).normal(size=6)
    for index in range(6):
        best = field.copy()
        best[index] = weights[index] @ field
        least = np.linalg.norm(differences @ best)
        for shift in (-1e-3, 1e-3):
            other = best.copy()
            other[index] += shift
            assert np.linalg.norm(differences @ other) > least


def test_a_gap_in_the_samples_is_not_a_cut_and_a_cut_is_one_at_uneven_times() -> None:
    rest, faces, frames = swing()
    repairer = Repairer(rest, faces)
    times = np.arange(6.0, 24.0)
    kept = np.delete(np.arange(6, 24), [5, 6, 12])
    gap = results_of(repairer, frames[kept], times=kept.astype(float))
    assert sum(crossings(rest, faces, gap)) == 0
    whole = roughness(times, results_of(repairer, frames[6:24]) - frames[6:24])
    assert roughness(kept.astype(float), gap - frames[kept]) < 2.0 * whole
    moved = frames[13:17, :, [1, 2, 0]] + 5.0
    first, second = kept[:8].astype(float), 100.0 + 0.5 * np.arange(4) ** 1.2
    both = np.concatenate([frames[kept][:8], moved])
    together = results_of(repairer, both, times=np.concatenate([first, second]))
    assert (together[:8] == results_of(repairer, both[:8], times=first)).all()
    assert (together[8:] == results_of(repairer, both[8:], times=second)).all()


def test_clearance_holds_in_clips() -> None:
    rest, faces, frames = swing()
    clearance = 0.02
    options = RepairOptions(clearance=clearance)
    results = Repairer(rest, faces, options=options).animation(frames[8:22])
    assert all(result.after.pairs == 0 for result in results)
    tips = [_gap(result.points) for result in results]
    plain = [_gap(r.points) for r in Repairer(rest, faces).animation(frames[8:22])]
    assert min(tips) > max(0.9 * clearance, min(plain))


def _gap(points: NDArray[np.float64]) -> float:
    """Smallest distance between vertices of the two arms of the pincers."""
    count = len(pincers(0.4)[0])
    first, second = points[: count // 4], points[-(count // 4) :]
    return float(np.linalg.norm(first[:, None] - second[None], axis=2).min())
