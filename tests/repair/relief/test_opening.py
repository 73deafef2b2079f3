"""A clearance never costs a pose that comes clean without one; what may be opened of it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair.diagnosis import Status
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.relief.opening import _with_share, opened_later, too_close
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import detected, gathered
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.strain.meter import StrainOptions
from tests.meshes import bent_tube, grid

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


def as_it_was(meshes: Any, frames: Any, judged: Any, *_: Any, **__: Any) -> Any:
    return judged


@pytest.mark.parametrize("clearance", [1e-6, 0.01])
def test_frames_that_come_clean_without_a_clearance_do_with_one(
    clearance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, found = repaired(0.0), repaired(clearance)
    assert all(own.status is Status.CLEAN for own in (*plain, *found))
    moved = [np.abs(a.points - b.points).max() for a, b in zip(found, plain, strict=True)]
    assert max(moved) < 2.0 * clearance + 1e-6
    monkeypatch.setattr("dtrepair.repair.clip.window_repairer.opened_later", as_it_was)
    assert any(own.status is not Status.CLEAN for own in repaired(clearance))


def test_what_is_too_close_is_opened_where_the_bounds_allow_it() -> None:
    clearance = 0.02
    repairer, pose = scene(clearance), FRAMES[1]
    meshes, opened = repairer.meshes, detected(repairer.scene, gathered(repairer.scene, [pose]))
    clean = scene(0.0)([pose])[0].points
    centred = np.asarray(clean - pose + opened.centred, dtype=np.float64)
    asked: list[float] = []

    def closely(way: WeldedMeshes) -> list[Judged]:
        asked.append(way.scene.options.clearance)
        return [Judged(centred)]

    def later(first: FloatArray) -> list[Judged]:
        return opened_later(meshes, [opened], [Judged(first)], np.zeros(1), closely)

    mesh = meshes([opened.sewn])
    (found,) = later(opened.centred)
    assert asked == [0.0] and len(repairer.scene.pairs(found.points, opened.weld)) == 0
    assert too_close(mesh, found.points) < too_close(mesh, centred)
    # What is clean is left at that, ...
    first = [Judged(centred)]
    assert opened_later(meshes, [opened], first, np.zeros(1), closely) is first
    assert asked == [0.0]
    # ... and what leaves no less is not taken.
    centred = opened.centred
    first = [Judged(opened.centred)]
    assert opened_later(meshes, [opened], first, np.zeros(1), closely) is first
    assert asked == [0.0, 0.0]


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
    own, mesh = Judged(frame.centred), meshes([frame.sewn])
    found = _with_share(scene, mesh, frame, own, moved, tries=1).points - frame.centred
    assert found.any() and np.linalg.norm(found, axis=1).max() <= 0.004 * (1.0 + 1e-6)
    before = frame.centred[of_plate]
    after = before + found[of_plate]
    old, new = (np.linalg.norm(pose - pose[:1], axis=1) for pose in (before, after))
    assert np.allclose(old, new, rtol=0.0, atol=1e-9)


def test_without_a_clearance_nothing_is_solved_again() -> None:
    assert scene(0.0).meshes.without_clearance is None
    paper = RepairOptions(method="paper", clearance=0.0)
    assert SceneRepairer([Body(REST, FACES)], options=paper).meshes.without_clearance is None
