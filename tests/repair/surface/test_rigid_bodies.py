"""Bodies that move as a whole only: edges keep their lengths, in single poses and in clips."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, RepairOptions, SceneRepairer, Status
from dtrepair.numerics.geometry import unique_edges
from dtrepair.repair.surface.rigid_bodies import RigidBodies, allowed
from tests.exact_reference import exact_pairs
from tests.meshes import Mesh, icosphere, joined, tube

BALL, BALL_FACES = icosphere(2)
TURN = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
AWAY = np.array([0.0, 5.0, 0.0])
HALF = np.array([[0.5, -(0.75**0.5), 0.0], [0.75**0.5, 0.5, 0.0], [0.0, 0.0, 1.0]])


def rod(shift: tuple[float, float, float] = (0.1, 0.05, 0.8)) -> Mesh:
    points, faces = tube(10, 24, radius=0.15, length=1.6)
    return points + shift, faces


def stretch(
    before: NDArray[np.float64], after: NDArray[np.float64], faces: NDArray[np.int32]
) -> float:
    """Largest relative change of an edge's length."""
    edges = unique_edges(faces)
    first, second = (
        np.linalg.norm(p[edges[:, 0]] - p[edges[:, 1]], axis=1) for p in (before, after)
    )
    return float(np.abs(second / first - 1.0).max())


def test_the_nearest_rigid_motion_of_a_rigid_motion_is_itself() -> None:
    moved = BALL @ TURN.T + [1.0, 2.0, 3.0]
    bodies = RigidBodies([(0, len(BALL))], np.random.default_rng(1).uniform(1, 2, len(BALL)))
    assert np.abs(bodies.fitted(BALL, moved) - moved).max() < 1e-12
    assert np.linalg.det(np.linalg.lstsq(BALL, bodies.fitted(BALL, -BALL), rcond=None)[0]) > 0.99
    once = bodies.fitted(BALL, moved + 1e-3)
    assert np.array_equal(bodies.fitted(BALL, once), once)
    noise = moved + 0.1 * np.random.default_rng(2).normal(size=BALL.shape)
    assert stretch(BALL, bodies.fitted(BALL, noise), BALL_FACES) < 1e-12


def test_forces_become_velocities_of_a_rigid_body() -> None:
    bodies = RigidBodies([(0, len(BALL))], np.ones(len(BALL)))
    others = np.full_like(BALL, 7.0)
    result = bodies.moved(BALL, np.tile([0.0, 0.0, 2.0], (len(BALL), 1)), others)
    assert np.allclose(result, [0.0, 0.0, 2.0]) and (others == 7.0).all()
    spin = np.cross([0.3, -0.2, 0.7], BALL)
    assert np.allclose(bodies.moved(BALL + 5.0, spin, others), spin)
    # Growing is no rigid motion.
    assert np.abs(bodies.moved(BALL, BALL, others)).max() < 1e-12


def test_only_rigid_bodies_are_fitted() -> None:
    both = np.concatenate([BALL, BALL])
    bodies = RigidBodies([(0, len(BALL))], np.ones(len(both)))
    wild = both + np.random.default_rng(0).normal(size=both.shape)
    fitted = bodies.fitted(both, wild)
    assert np.array_equal(fitted[len(BALL) :], wild[len(BALL) :])
    assert stretch(BALL, fitted[: len(BALL)], BALL_FACES) < 1e-12
    assert bodies.fitted(both, both) is not both and np.array_equal(bodies.fitted(both, both), both)


@pytest.mark.parametrize("limit", [0.01, 0.3, 2.0])
def test_a_limit_shortens_the_whole_motion(limit: float) -> None:
    both = np.concatenate([BALL, BALL])
    bodies = RigidBodies([(0, len(BALL))], np.ones(len(both)))
    turned = np.concatenate([BALL @ HALF.T + 0.2, BALL + AWAY])
    result = allowed(bodies, both, turned, limit)
    length = np.linalg.norm(result - both, axis=1)
    assert length.max() <= limit and length[len(BALL) :].min() > 0.999 * limit
    assert stretch(BALL, result[: len(BALL)], BALL_FACES) < 1e-12
    assert length[: len(BALL)].max() > 0.5 * min(limit, 1.0)


@pytest.mark.parametrize("rigid", [(True, True), (True, False), (False, True)])
def test_rigid_bodies_separate(rigid: tuple[bool, bool]) -> None:
    meshes = [(BALL, BALL_FACES), rod()]
    bodies = [Body(*mesh, rigid=own) for mesh, own in zip(meshes, rigid, strict=True)]
    results = SceneRepairer(bodies)([points for points, _ in meshes])
    assert results[0].before.pairs > 20
    after = [(r.points, faces) for r, (_, faces) in zip(results, meshes, strict=True)]
    assert len(exact_pairs(*joined(*after))) == 0
    for result, (points, faces), own in zip(results, meshes, rigid, strict=True):
        assert result.status is Status.CLEAN and result.displacement_max > 0
        # Rounding to float32 is all that may change an edge.
        shortest = 0.03
        assert not own or stretch(points, result.points, faces) < 3e-7 / shortest


def test_a_rigid_body_keeps_a_limit_and_a_collider_its_place() -> None:
    meshes = [(BALL, BALL_FACES), rod((0.0, 0.0, 1.5))]
    bodies = [Body(*meshes[0], mobility=0.0), Body(*meshes[1], rigid=True)]
    options = RepairOptions(maximum_displacement=0.02)
    results = SceneRepairer(bodies, options=options)([points for points, _ in meshes])
    assert np.array_equal(results[0].points, BALL)
    moved = np.linalg.norm(results[1].points - meshes[1][0], axis=1)
    assert moved.max() <= 0.02 and results[1].status is not Status.CLEAN
    free = SceneRepairer(bodies)([points for points, _ in meshes])
    assert all(result.status is Status.CLEAN for result in free)
    assert stretch(meshes[1][0], free[1].points, meshes[1][1]) < 1e-5


def test_a_pinned_vertex_holds_a_rigid_body() -> None:
    mesh = rod()
    pin = np.zeros(len(mesh[0]))
    pin[3] = 1.0
    bodies = [Body(BALL, BALL_FACES), Body(*mesh, rigid=True, pin=pin)]
    results = SceneRepairer(bodies)([BALL, mesh[0]])
    assert np.array_equal(results[1].points, mesh[0])
    assert results[0].status is Status.CLEAN


def test_a_clip_is_rigid_and_steady() -> None:
    mesh = rod()
    depth = 0.9 * np.cos(np.linspace(-1.6, 1.6, 24))
    poses = [[BALL, mesh[0] + [0.0, 0.0, 1.15 - d]] for d in depth]
    bodies = [Body(BALL, BALL_FACES, mobility=0.0), Body(*mesh, rigid=True)]
    scene = SceneRepairer(bodies)
    frames = list(scene.animator.stream(list(enumerate(poses)), jobs=1))
    assert sum(frame.results[1].before.pairs > 0 for frame in frames) > 5
    moved = []
    for frame, (_, points) in zip(frames, poses, strict=True):
        assert [result.after.pairs for result in frame.results] == [0, 0]
        assert stretch(points, frame.results[1].points, mesh[1]) < 1e-5
        moved.append(frame.results[1].points - points)
    motion = np.array(moved)
    second = np.linalg.norm(np.diff(motion, 2, axis=0), axis=2).max()
    assert second < 0.5 * np.linalg.norm(motion, axis=2).max()
