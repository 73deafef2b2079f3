"""Bodies of a high diffusion keep their shape in clips."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, SceneRepairer, Status
from dtrepair.numerics.geometry import unique_edges
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.repair.clip import animation
from dtrepair.repair.clip import restore_shape as stiffen
from dtrepair.repair.clip import window_method as shot
from tests.meshes import icosphere

BALL, BALL_FACES = icosphere(2)
ROD, ROD_FACES = BALL * np.array([0.2, 0.2, 0.8]), BALL_FACES


def bending(diffusion: float, mobility: float = 0.0) -> float:
    """Root mean square of the rod's edge changes in a clip that is repaired clean."""
    depth = 0.9 * np.cos(np.linspace(-1.6, 1.6, 12))
    poses = [[BALL, ROD + np.array([0.3, 0.1, 1.75 - d])] for d in depth]
    bodies = [
        Body(BALL, BALL_FACES, mobility=mobility),
        Body(ROD, ROD_FACES, diffusion=diffusion),
    ]
    frames = list(SceneRepairer(bodies).animator.stream(list(enumerate(poses)), jobs=1))
    edges = unique_edges(ROD_FACES)
    changes = []
    for frame, (_, before) in zip(frames, poses, strict=True):
        assert all(result.status is Status.CLEAN for result in frame.results)
        changes.append(edge_log_ratio(before, frame.results[1].points, edges))
    assert sum(change > 0 for change in changes) > 3
    return float(np.sqrt(np.mean(np.square(changes))))


@pytest.fixture(autouse=True)
def contacts_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No body is led out of another as a whole."""
    monkeypatch.setattr(animation, "parted_frames", lambda scene, system, poses, *_, **__: poses)


@pytest.mark.parametrize("mobility", [0.0, 1.0])
def test_a_stiff_body_hardly_bends(mobility: float, monkeypatch: pytest.MonkeyPatch) -> None:
    stiff = bending(999.0, mobility)
    monkeypatch.setattr(shot, "stiffen_frames", lambda state: None)
    bent = bending(999.0, mobility)
    assert stiff < 0.8 * bent


def test_what_stretches_a_soft_body_is_evened_out(monkeypatch: pytest.MonkeyPatch) -> None:
    soft = bending(99.0)
    monkeypatch.setattr(shot, "stiffen_frames", lambda state: None)
    assert soft < 0.95 * bending(99.0)


def test_a_soft_body_that_is_hardly_stretched_is_left_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stiffen, "LITTLE", 1.0)
    soft = bending(99.0)
    monkeypatch.setattr(shot, "stiffen_frames", lambda state: None)
    assert soft == bending(99.0)


def test_pinned_vertices_of_a_stiff_body_hold() -> None:
    pin = np.zeros(len(ROD))
    pin[ROD[:, 2] > 0.6] = 1.0
    depth = 0.5 * np.cos(np.linspace(-1.6, 1.6, 8))
    poses = [[BALL, ROD + np.array([0.3, 0.1, 1.75 - d])] for d in depth]
    bodies = [Body(BALL, BALL_FACES), Body(ROD, ROD_FACES, diffusion=999.0, pin=pin)]
    frames = list(SceneRepairer(bodies).animator.stream(list(enumerate(poses)), jobs=1))
    for frame, (_, before) in zip(frames, poses, strict=True):
        assert np.array_equal(frame.results[1].points[pin > 0], before[pin > 0])
    assert frames[4].results[1].displacement_max > 0
