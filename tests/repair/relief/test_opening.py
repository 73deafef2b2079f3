"""Contacts are opened last: a clearance never costs a pose that comes clean without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtrepair.diagnosis import Status, StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.relief import opening
from dtrepair.repair.relief.opening import OpeningOptions, _Opening, opened_frames, too_close
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.strain.bounds import Excess, StrainOptions
from tests.meshes import bent_tube, grid, icosphere, joined

ALONG, UP = np.eye(3)[:2]
REST, FACES = bent_tube(0.1, around=12, along=40, radius=0.08)
FRAMES = [bent_tube(a, around=12, along=40, radius=0.08)[0] for a in (6.4, 6.5, 6.6, 6.7)]
# No edge may change by more than 8 %: without a clearance none does by 6, with one some do by 11.
TIGHT = ClipOptions(
    independent=IndependentOptions(strain=StrainOptions(factor=1.08, edges=0, edges_share=0.0))
)


def scene(clearance: float, clip: ClipOptions | None = None) -> SceneRepairer:
    options = RepairOptions(clearance=clearance)
    return SceneRepairer([Body(REST, FACES)], options=options, clip=clip)


def repaired(clearance: float) -> list[RepairResult]:
    frames = ((float(time), [pose]) for time, pose in enumerate(FRAMES))
    return [frame.results[0] for frame in scene(clearance, TIGHT).animator.stream(frames, jobs=1)]


@pytest.mark.parametrize("clearance", [1e-6, 0.01])
def test_frames_that_come_clean_without_a_clearance_do_with_one(clearance: float) -> None:
    plain, found = repaired(0.0), repaired(clearance)
    assert all(own.status is Status.CLEAN for own in (*plain, *found))
    moved = [np.abs(a.points - b.points).max() for a, b in zip(found, plain, strict=True)]
    assert max(moved) < 2.0 * clearance + 1e-6
    assert clearance < 0.01 or max(moved) > 0.0


def window(clearance: float) -> tuple[SceneRepairer, list[OpenedPose], list[Judged], WeldedMesh]:
    """The frames as they come clean without a clearance, and the mesh that knows it."""
    repairer = scene(clearance)
    frames = [detected(repairer.scene, gathered(repairer.scene, [pose])) for pose in FRAMES]
    moved = [own.points - pose for own, pose in zip(repaired(0.0), FRAMES, strict=True)]
    judged = [Judged(own.centred + by) for own, by in zip(frames, moved, strict=True)]
    return repairer, frames, judged, repairer.meshes([own.sewn for own in frames])


def test_what_is_too_close_is_opened_and_smoothing_closes_none_of_it_again() -> None:
    repairer, frames, judged, mesh = window(0.02)
    # One frame in which it is, beside others in which nothing is near anything.
    far = bent_tube(3.0, around=12, along=40, radius=0.08)[0]
    apart = detected(repairer.scene, gathered(repairer.scene, [far]))
    frames, judged = (
        [apart, frames[2], apart],
        [Judged(apart.centred), judged[2], Judged(apart.centred)],
    )
    close, second = [], []
    for widths in ((1.0, 0.5, 0.0), (1.0,), (0.0,)):
        options = OpeningOptions(widths=widths)
        found = opened_frames(repairer.scene, mesh, frames, judged, np.arange(3.0), options=options)
        assert len(repairer.scene.pairs(found[1].points, frames[1].weld)) == 0
        close.append(too_close(mesh, found[1].points))
        poses = np.stack([own.points - was.points for own, was in zip(found, judged, strict=True)])
        second.append(np.abs(np.diff(poses, 2, axis=0)).max())
    assert close[0] == close[2] == 0 < close[1] < too_close(mesh, judged[1].points)
    # Opened each for itself they move less evenly in time.
    assert second[0] < second[2]


def test_frames_that_are_held_are_opened_as_one() -> None:
    repairer, frames, judged, mesh = window(0.01)
    order, times = [0, 1, 1, 1, 2, 3], np.arange(6.0)
    given, known = [frames[k] for k in order], [judged[k] for k in order]
    found = [own.points for own in opened_frames(repairer.scene, mesh, given, known, times)]
    assert np.array_equal(found[1], found[2]) and np.array_equal(found[1], found[3])
    once = opened_frames(repairer.scene, mesh, frames, judged, np.arange(4.0))
    assert all(np.array_equal(once[k].points, own) for k, own in zip(order, found, strict=True))


@pytest.mark.parametrize("told", [False, True])
def test_what_does_not_bear_it_is_left_where_it_is(
    told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where a share within the bounds is left, of which is told what it would be without."""
    repairer, frames, judged, mesh = window(0.01)
    bent = Excess(StrainKind.EDGES, 0, 9.0, 5.0, 0, np.zeros(1, dtype=np.int32))
    known = [own._replace(excess=(bent,), lowered=True) if told else own for own in judged]

    def strained(_: object, __: object, after: FloatArray) -> tuple[Excess, ...]:
        return () if any(np.array_equal(after, own.points) for own in judged) else (bent,)

    monkeypatch.setattr(opening, "strain_of", strained)
    found = opened_frames(repairer.scene, mesh, frames, known, np.arange(4.0))
    assert all(own.points is was.points for own, was in zip(found, judged, strict=True))
    at_any_cost = replace(repairer.scene.options, at_any_cost=True)
    anyhow = repairer.scene.changed(options=at_any_cost)
    found = opened_frames(anyhow, mesh, frames, known, np.arange(4.0))
    assert all(own.points is not was.points for own, was in zip(found, judged, strict=True))


def test_opened_poses_keep_to_the_limit_and_rigid_bodies_to_their_shape() -> None:
    # A tube that may move a little from where it is, and a plate beside it that must not bend.
    plate, square = grid(4, 4)
    plate = 0.4 * plate + REST.mean(axis=0) + (0.0, 0.0, 0.3)
    options = RepairOptions(clearance=0.02, maximum_displacement=0.004)
    bodies = [Body(REST, FACES), Body(plate, square, rigid=True)]
    repairer = SceneRepairer(bodies, options=options)
    scene, meshes = repairer.scene, repairer.meshes
    frame = detected(scene, gathered(scene, [REST, plate]))
    of_plate = np.arange(len(scene.rest)) >= len(REST)
    random = np.random.default_rng(0)
    moved = random.normal(size=scene.rest.shape) * 0.01  # as if smoothed: neither rigid nor near
    poses, numbers = [(frame, Judged(frame.centred))], OpeningOptions(tries=1)
    state = _Opening(scene, meshes([frame.sewn]), poses, WorkerPool(), numbers)
    state.move(0, moved)
    found = state.judged[0].points - frame.centred
    assert found.any() and np.linalg.norm(found, axis=1).max() <= 0.004 * (1.0 + 1e-6)
    before = frame.centred[of_plate]
    after = before + found[of_plate]
    old, new = (np.linalg.norm(pose - pose[:1], axis=1) for pose in (before, after))
    assert np.allclose(old, new, rtol=0.0, atol=1e-9)


def test_frames_at_rest_are_opened_no_more_than_those_beside_them() -> None:
    """Two balls are near each other in the rest, with which the clip begins."""
    ball, faces = icosphere(2)
    points, faces = joined((ball, faces), (ball + (np.ptp(ball[:, 0]) + 0.01) * ALONG, faces))
    poses = [points + 0.004 * max(0, index - 3) * points[:, :1] * UP for index in range(8)]
    repairer = SceneRepairer([Body(points, faces)], options=RepairOptions(clearance=0.05))
    given = ((float(time), [pose]) for time, pose in enumerate(poses))
    found = [frame.results[0].points for frame in repairer.animator.stream(given, jobs=1)]
    assert all(np.array_equal(own, pose) for own, pose in zip(found, poses, strict=True))
    # A pose alone that is its own rest has nothing that excuses what is near.
    assert not np.array_equal(repairer([points])[0].points, points)


def test_without_a_clearance_meshes_are_their_own() -> None:
    plain, apart = scene(0.0).meshes, scene(0.01).meshes
    assert plain.without_clearance is plain
    assert apart.without_clearance.scene.options.clearance == 0.0
