"""Windows whose layers were lifted go back towards their inputs, on the side they are on."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, SceneRepairer
from dtrepair.numerics.geometry import FloatArray, lengths
from tests.repair.clip.test_settle_frames import window
from tests.repair.separation.test_lifting import ARM, SLEEVE, radius, swollen

FRAMES = 7


@pytest.fixture(scope="module")
def moved() -> FloatArray:
    """How far an arm that swells through its sleeve in one frame of seven moves that (T, V)."""
    swells = 0.4 * np.exp(-(((np.arange(FRAMES) - 3.0) / 0.8) ** 2))
    poses = [
        (float(time), [swollen(ARM[0], growth), SLEEVE[0]]) for time, growth in enumerate(swells)
    ]
    repairer, before, found = SceneRepairer([Body(*ARM), Body(*SLEEVE)]), [], []
    frames = repairer.animator.stream(poses, jobs=1)
    for frame, swell in zip(frames, swells, strict=True):
        arm, sleeve = frame.results
        assert sleeve.status == "clean"
        before.append(arm.before.pairs)
        found.append(sleeve.points)
        # On the outside of the arm all round, at each height of its own.
        beneath = np.column_stack([np.full((len(SLEEVE[0]), 2), 0.2), sleeve.points[:, 2]])
        beneath[:, 1] = 0.0
        assert (radius(sleeve.points) > 0.97 * radius(swollen(beneath, swell))).all()
    assert [pairs > 0 for pairs in before] == [False] * 3 + [True] + [False] * 3
    return np.stack([lengths(points - SLEEVE[0]) for points in found])


def test_frames_beside_a_deep_one_are_led_less_the_farther_they_are(moved: FloatArray) -> None:
    largest = moved.max(axis=1)
    # Lifts are smooth over 3.5 frames: the first frame had .85 of the deepest.
    assert largest[0] < 0.4 * largest[3] and largest[-1] < 0.4 * largest[3]
    assert (np.diff(largest[:4]) > 0.0).all() and (np.diff(largest[3:]) < 0.0).all()


def test_the_deep_frame_is_led_as_far_as_it_needs(moved: FloatArray) -> None:
    # Where the arm is thickest it is .28 wide, the sleeve .23.
    assert 0.045 < moved[3].max() < 0.08


def test_poses_stay_where_displacements_are_counted_from_elsewhere() -> None:
    state, _ = window()
    state.work.smooth[:] = 1e-3
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
