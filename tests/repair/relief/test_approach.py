"""What no push frees is led to its pose from the rest, and comes out on the side it came from."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.diagnosis import Status
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.work import work_done
from dtrepair.repair.full.method import FullOptions
from dtrepair.repair.full.phases import PhaseOptions
from dtrepair.repair.independent import IndependentOptions, repair_poses, solved_pose
from dtrepair.repair.relief.approach import ApproachOptions, approached
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import armed_body

REST, FACES = armed_body(1.5)
# The arm goes through the body it grows from, and out on the other side.
POSE = armed_body(5.0)[0]
BESIDE = np.array([9.0, 0.0, 0.0])


def curled(pose: FloatArray = POSE, **options: Any) -> tuple[Scene, WeldedMeshes, OpenedPose]:
    """The scene of a body whose arm is curled, its meshes, and a pose of it."""
    scene = make_scene([Body(REST, FACES)], RepairOptions(**options))
    return scene, WeldedMeshes(scene), detected(scene, gathered(scene, [pose]))


def led(pose: FloatArray = POSE, **options: Any) -> tuple[Scene, OpenedPose, FloatArray]:
    """The scene, the pose, and where it is led if nothing was found for it."""
    scene, meshes, opened = curled(pose, **options)
    return scene, opened, approached(scene, meshes([opened.weld]), opened, opened.centred)


def test_an_arm_through_its_body_is_led_out_of_it() -> None:
    scene, opened, found = led()
    assert len(opened.pairs) > 20
    assert len(scene.pairs(found, opened.weld)) == 0
    assert not scene.strain_meter(opened.centred, found)


@pytest.mark.parametrize(
    "options",
    [{"clearance": 0.01}, {"skip": ("approach",)}, {"method": "paper"}],
    ids=lambda options: next(iter(options)),
)
def test_some_options_leave_it_out(options: dict[str, Any]) -> None:
    _, opened, found = led(**options)
    assert found is opened.centred


def test_nothing_moves_beyond_the_limit() -> None:
    _, opened, found = led(maximum_displacement=1e-3)
    assert found is opened.centred
    _, opened, found = led(maximum_displacement=2.0)
    assert 1e-3 < lengths(found - opened.centred).max() <= 2.0


def test_what_is_clean_and_whole_is_left_as_it_was_found() -> None:
    scene, opened, found = led()
    meshes = WeldedMeshes(scene)
    assert approached(scene, meshes([opened.weld]), opened, found) is found


def test_a_pose_that_is_its_rest_has_no_way_to_go() -> None:
    scene = make_scene([Body(POSE, FACES)], RepairOptions(rest_contacts="repair"))
    opened = detected(scene, gathered(scene, [POSE + BESIDE]))
    before = work_done()
    mesh = WeldedMeshes(scene)([opened.weld])
    assert approached(scene, mesh, opened, opened.centred) is opened.centred
    assert work_done() - before < ApproachOptions().work


def test_it_ends_when_its_work_is_done() -> None:
    scene, meshes, opened = curled()
    mesh = meshes([opened.weld])
    none = ApproachOptions(work=0.0, work_a_triangle=0.0)
    assert approached(scene, mesh, opened, opened.centred, options=none) is opened.centred
    _, opened, found = led(effort=1e-9)
    assert found is opened.centred


def test_bodies_that_move_freely_have_no_common_rest() -> None:
    scene = make_scene([Body(REST, FACES), Body(REST + BESIDE, FACES)], RepairOptions())
    opened = detected(scene, gathered(scene, [POSE, POSE + BESIDE]))
    mesh = WeldedMeshes(scene)([opened.weld])
    assert approached(scene, mesh, opened, opened.centred) is opened.centred


def test_poses_and_frames_are_led_in_where_nothing_else_frees_them() -> None:
    """A method whose pushes move nothing leaves all as it was."""
    scene, _, opened = curled(skip=("fill", "insist"))
    still = FullOptions(phases=PhaseOptions(first_steps=(1e-9,)))
    meshes = WeldedMeshes(scene, full=still)
    none = IndependentOptions(approach=ApproachOptions(work=0.0, work_a_triangle=0.0))
    for options, clean in ((none, False), (IndependentOptions(), True)):
        found = solved_pose(scene, meshes, opened, options=options)
        assert (len(scene.pairs(found, opened.weld)) == 0) == clean
        ((result,),) = repair_poses(scene, meshes, [[POSE]], options=options)
        assert (result.status is Status.CLEAN) == clean
