"""What no push frees is led to its pose from the rest, and comes out on the side it came from."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair import Body, RepairOptions
from dtrepair.diagnosis import Status
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.work import work_done
from dtrepair.repair.frame.lending import LendingOptions
from dtrepair.repair.full.biharmonic_fill import FillOptions
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.method import FullOptions
from dtrepair.repair.full.phases import PhaseOptions
from dtrepair.repair.independent import repair_poses
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.relief.approach import ApproachOptions, bounded_approach
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.single_poses import approached, bounded_poses, solved_pose
from tests.meshes import armed_body

REST, FACES = armed_body(1.5)
# The arm goes through the body it grows from, and out on the other side.
POSE = armed_body(5.0)[0]
BESIDE = np.array([9.0, 0.0, 0.0])
NONE = ApproachOptions(work=0.0, work_a_triangle=0.0)
USUAL = ApproachOptions()
# Pushes and fills that move nothing.
STILL = FillOptions(rounds=0)
IDLE = PhaseOptions(first_steps=(1e-9,), insist_steps=(), fill=STILL, last_fill=STILL)


def turned(pose: FloatArray, seed: int) -> FloatArray:
    """A pose (V, 3) turned as a whole."""
    turn = Rotation.from_quat(np.random.default_rng(seed).normal(size=4))
    return np.asarray(pose @ turn.as_matrix().T)


def opened_scene(*bodies: tuple[Body, FloatArray], **options: Any) -> tuple[Scene, OpenedPose]:
    """The scene of bodies, and a pose of it."""
    scene = make_scene([body for body, _ in bodies], RepairOptions(**options))
    return scene, detected(scene, gathered(scene, [pose for _, pose in bodies]))


def curled(
    pose: FloatArray = POSE, pin: NDArray[np.bool_] | None = None, **options: Any
) -> tuple[Scene, OpenedPose]:
    """The scene of a body whose arm is curled, and a pose of it."""
    return opened_scene((Body(REST, FACES, pin=pin), pose), **options)


def led(
    scene: Scene,
    opened: OpenedPose,
    found: FloatArray | None = None,
    options: ApproachOptions = USUAL,
) -> tuple[FloatArray, IntArray]:
    """The pose that is kept, and its pairs; `found`: what the usual way did, default: nothing."""
    points = opened.centred if found is None else found
    pairs_of = partial(scene.pairs, weld=opened.weld)
    usual = Judged(points, tuple(scene.strain_meter(opened.centred, points))), pairs_of(points)
    mesh = WeldedMeshes(scene)([opened.weld])
    judged, pairs = bounded_approach(scene, mesh, opened, usual, pairs_of, options=options)
    return judged.points, pairs


def test_an_arm_through_its_body_is_led_out_of_it() -> None:
    scene, opened = curled()
    assert len(opened.pairs) > 20
    found, pairs = led(scene, opened)
    assert len(pairs) == 0 == len(scene.pairs(found, opened.weld))
    assert not scene.strain_meter(opened.centred, found)


def test_however_it_is_turned_it_mostly_comes_out() -> None:
    """Rounding tells which contacts are pushed first; some orientation may fail by little."""
    out = 0
    for seed in range(1, 9):
        scene, opened = curled(turned(POSE, seed))
        found, pairs = led(scene, opened)
        assert found is opened.centred or not scene.strain_meter(opened.centred, found)
        out += len(pairs) == 0
    assert out >= 5


@pytest.mark.parametrize(
    "options",
    [
        {"skip": ("approach",)},
        {"skip": ("fill",)},
        {"tighten": 0},
        {"method": "paper"},
        {"maximum_displacement": 1.0},
    ],
    ids=lambda options: "-".join(map(str, *options.items())),
)
def test_some_options_leave_it_out(options: dict[str, Any]) -> None:
    scene, opened = curled(**options)
    assert led(scene, opened)[0] is opened.centred


def test_what_is_clean_and_whole_is_left_as_it_was_found() -> None:
    scene, opened = curled()
    found, _ = led(scene, opened)
    assert led(scene, opened, found)[0] is found


def test_a_clean_pose_is_not_given_up_for_one_that_intersects() -> None:
    """However strained it is, if the user wants it at any cost."""
    scene, opened = curled(at_any_cost=True)
    large = 9.0 * REST
    assert scene.strain_meter(opened.centred, large) and not len(scene.pairs(large, opened.weld))
    # What is led in is clean as well, and whole; if nothing cleans it, it is not.
    found, pairs = led(scene, opened, large)
    assert found is not large and len(pairs) == 0
    idle = LendingOptions(step=1e-9, mend=MendOptions(fill=STILL), phases=IDLE)
    assert len(led(scene, opened, options=ApproachOptions(lending=idle))[1])
    assert led(scene, opened, large, ApproachOptions(lending=idle))[0] is large


@pytest.mark.parametrize("step", [0.25, 0.3])
def test_what_is_pinned_stays_to_the_bit(step: float) -> None:
    pin = np.arange(len(REST)) < 120
    scene, opened = curled(pin=pin)
    found, pairs = led(scene, opened, options=ApproachOptions(step=step))
    assert len(pairs) < len(opened.pairs)
    assert np.array_equal(found[pin], opened.centred[pin])


def test_a_pose_that_is_its_rest_has_no_way_to_go() -> None:
    scene, opened = opened_scene((Body(POSE, FACES), POSE + BESIDE), rest_contacts="repair")
    before = work_done()
    assert led(scene, opened)[0] is opened.centred
    # Two factors and a few detections; a step cleans and relaxes.
    assert work_done() - before < 30.0 * len(FACES)


def test_it_ends_when_its_work_is_done() -> None:
    scene, opened = curled()
    assert led(scene, opened, options=NONE)[0] is opened.centred
    scene, opened = curled(effort=1e-9)
    assert led(scene, opened)[0] is opened.centred


def test_bodies_that_move_freely_have_no_common_rest() -> None:
    both = ((Body(REST + away, FACES), POSE + away) for away in (0.0 * BESIDE, BESIDE))
    scene, opened = opened_scene(*both)
    assert led(scene, opened)[0] is opened.centred


def test_poses_and_frames_are_led_in_where_nothing_else_frees_them() -> None:
    """A method whose pushes and fills move nothing leaves all as it was."""
    scene, opened = curled()
    meshes = WeldedMeshes(scene, full=FullOptions(phases=IDLE))
    for options, clean in (
        (IndependentOptions(approach=NONE), False),
        (IndependentOptions(), True),
    ):
        found = solved_pose(scene, meshes, opened, options=options)
        assert (len(scene.pairs(found, opened.weld)) == 0) == clean
        ((result,),) = repair_poses(scene, meshes, [[POSE]], options=options)
        assert (result.status is Status.CLEAN) == clean


def test_led_in_afterwards_is_the_same_as_at_once() -> None:
    """So that of several ways only the best is led in."""
    scene, opened = curled()
    idle = WeldedMeshes(scene, full=FullOptions(phases=IDLE))
    options, known = IndependentOptions(), (scene, idle, [opened])
    (at_once,) = bounded_poses(*known, options)
    (without,) = bounded_poses(*known, options, approach=False)
    assert len(without.pairs) > 0 == len(at_once.pairs)
    later = approached(opened, without._replace(seconds=1e6), options)
    assert np.array_equal(later.judged.points, at_once.judged.points)
    assert later.seconds > 1e6
    assert approached(opened, at_once, options).judged is at_once.judged
