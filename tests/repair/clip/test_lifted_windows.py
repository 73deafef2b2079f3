"""Windows whose layers were lifted go back towards their inputs, on the side they are on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair import Body, SceneRepairer
from dtrepair.numerics.geometry import lengths
from dtrepair.repair.clip.mend_frames import lend_nearer
from dtrepair.repair.clip.restore_shape import RelaxFramesOptions, relax_frames
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.opened_pose import detected, gathered
from dtrepair.repair.separation.starts import Starts
from tests.repair.clip.test_settle_frames import window
from tests.repair.separation.test_lifting import ARM, SLEEVE, radius, swollen

FRAMES = 24
SWELLS = 0.4 * np.exp(-(((np.arange(FRAMES) - 0.5 * (FRAMES - 1)) / 4.0) ** 2))


def repaired(jobs: int) -> list[list[RepairResult]]:
    """An arm that swells through its sleeve in the middle of a clip."""
    poses = [
        (float(time), [swollen(ARM[0], swell), SLEEVE[0]]) for time, swell in enumerate(SWELLS)
    ]
    stream = SceneRepairer([Body(*ARM), Body(*SLEEVE)]).animator.stream(poses, jobs=jobs)
    return [list(frame.results) for frame in stream]


@pytest.fixture(scope="module")
def found() -> list[list[RepairResult]]:
    return repaired(1)


def test_a_sleeve_stays_outside_of_its_arm_in_every_frame(found: list[list[RepairResult]]) -> None:
    met = [arm.before.pairs > 0 for arm, _ in found]
    assert 4 <= sum(met) <= 12 and not (met[0] or met[-1])
    for (_, sleeve), swell in zip(found, SWELLS, strict=True):
        assert sleeve.status == "clean" and sleeve.after.pairs == 0
        beneath = np.zeros_like(sleeve.points)
        beneath[:, 0], beneath[:, 2] = 0.2, sleeve.points[:, 2]
        assert (radius(sleeve.points) > 0.97 * radius(swollen(beneath, swell))).all()


def test_frames_beside_deep_ones_are_led_less_the_farther_they_are(
    found: list[list[RepairResult]],
) -> None:
    largest = np.array([lengths(sleeve.points - SLEEVE[0]).max() for _, sleeve in found])
    # Where the arm is thickest it is .28 wide, the sleeve .23; a lift of 3.5 frames reaches all.
    assert 0.045 < largest.max() < 0.08
    assert largest[[0, 1, 2, -3, -2, -1]].max() < 0.1 * largest.max()
    assert np.abs(np.diff(largest)).max() < 0.5 * largest.max()


def test_workers_find_the_same_bits(found: list[list[RepairResult]]) -> None:
    for ours, theirs in zip(found, repaired(2), strict=True):
        assert all(np.array_equal(a.points, b.points) for a, b in zip(ours, theirs, strict=True))


def test_poses_without_lifts_are_the_input_to_the_bit() -> None:
    repairer = SceneRepairer([Body(*ARM), Body(*SLEEVE)])
    scene = repairer.scene
    turned = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    poses = [[swollen(ARM[0], swell) @ turned, SLEEVE[0] @ turned] for swell in SWELLS[::4]]
    frames = [detected(scene, gathered(scene, pose)) for pose in poses]
    mesh = repairer.meshes([scene.rest_weld])
    starts = Starts(scene, mesh, frames, np.arange(float(len(frames))))
    inputs = np.stack([frame.centred for frame in frames])
    assert not np.array_equal(starts.lifted, inputs)
    assert np.array_equal(starts.unlifted(starts.lifted), inputs)
    aside = starts.lifted + 0.1
    assert np.allclose(starts.unlifted(aside), inputs + 0.1, atol=1e-12)


def test_poses_stay_where_displacements_are_counted_from_elsewhere() -> None:
    state, _ = window()
    state.work.smooth[:] = 1e-3
    state.work.folds.hits[:] = 1
    state.evaluate()
    poses, pairs = state.poses.copy(), [found.copy() for found in state.pairs]
    inputs = state.original + np.array([0.0, 0.0, 2e-3])
    inputs[0] = poses[0]
    state.count_from(inputs)
    assert np.array_equal(state.original, inputs)
    assert np.allclose(state.poses, poses, atol=1e-12)
    assert all(map(np.array_equal, pairs, state.pairs))
    # What the new inputs intersect, not what the old ones did.
    assert not len(state.found[0]) and len(state.found[3])
    state.work.extra[:] = 0.0
    state.evaluate()
    assert np.allclose(state.poses, inputs, atol=1e-12)


def state_of(*swells: float) -> WindowState:
    """Frames of the arm and its sleeve."""
    repairer = SceneRepairer([Body(*ARM), Body(*SLEEVE)])
    mesh = repairer.meshes([repairer.scene.rest_weld])
    poses = [np.concatenate([swollen(ARM[0], swell), SLEEVE[0]]) for swell in swells]
    unit = np.stack([mesh.reduced(pose) for pose in poses])
    frames = np.arange(float(len(swells)))
    return WindowState(mesh.surface, unit, frames, WorkerPool(), alone=lambda _, pose: pose)


def test_steps_suit_what_met_before_the_lift() -> None:
    state, through = state_of(0.0, 0.0), state_of(0.4, 0.0)
    assert state.scale == 1.0 and through.scale < 0.5
    state.count_from(through.original)
    assert state.scale == through.scale


def test_clothes_that_nothing_pushed_are_not_solved_frame_by_frame() -> None:
    state = state_of(0.0, 0.0)
    assert state.surface.covering is not None and not lend_nearer(state)


@pytest.mark.parametrize(("alone", "lifted"), [(False, True), (True, True), (False, False)])
def test_all_that_moved_agrees_more_where_only_lifts_moved_it(
    alone: bool, lifted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, options = state_of(0.0, 0.0, 0.0), RelaxFramesOptions()
    state.work.extra[:, : len(ARM[0])] += [0.0, 0.0, 1e-3]
    state.evaluate()
    asked: list[Any] = []
    monkeypatch.setattr(state, "relax", lambda *given, **_: asked.extend(given))
    relax_frames(state, alone=alone, lifted=lifted, options=options)
    if not (alone or lifted):
        assert not asked  # bodies that move freely lean on each other
        return
    assert asked[2] == (options.agreement if alone else options.lifted)
    assert asked[0] == [0, 1, 2] and asked[1].any()
