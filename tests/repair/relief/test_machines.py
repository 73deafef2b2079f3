"""A machine, whose bodies move as wholes about joints, stays rigid where it comes clean so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dtrepair import Status
from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.relief import props
from dtrepair.repair.relief.props import machine_kept_whole
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.props import MachineOptions, as_wholes, machine_bodies
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.strain.bounds import Excess
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from tests.repair.relief.test_relief import winged

ANGLES = (0.9, 1.0, 1.1, 1.2)
PIN = np.zeros(len(winged(0.9)[0].bodies[0].rest))  # type: ignore[arg-type]


def frames(angles: Sequence[float] = ANGLES) -> tuple[Scene, list[OpenedPose]]:
    """A trunk and a wing that turns until it lies on the trunk, as frames of one scene."""
    every = [winged(angle) for angle in angles]
    return every[0][0], [frame for _, frame, _ in every]


def centred(poses: Sequence[OpenedPose]) -> list[FloatArray]:
    return [pose.centred for pose in poses]


def bent_by(before: FloatArray, after: FloatArray) -> float:
    whole = RigidBodies([(0, len(before))], np.ones(len(before))).fitted(before, after)
    return float(np.abs(whole - after).max())


def test_bodies_that_turn_against_each_other_are_a_machine() -> None:
    scene, poses = frames()
    assert machine_bodies(scene, centred(poses)) == (0, 1)
    # Where nothing turns it stands in the pose of the rest, and tells nothing.
    assert machine_bodies(scene, [scene.centred_rest]) == ()
    # The wing of 480 of 1,152 triangles moves by .5 diagonals against the trunk.
    for few, found in ((0.4, (0, 1)), (0.45, ())):
        own = MachineOptions(turning=few)
        assert machine_bodies(scene, centred(poses), options=own) == found
    for far, found in ((0.2, (0, 1)), (1.0, ())):
        own = MachineOptions(against=far)
        assert machine_bodies(scene, centred(poses), options=own) == found
    bent = [pose.centred + 0.02 * pose.centred[:, [2, 0, 1]] ** 2 for pose in poses]
    assert machine_bodies(scene, bent) == ()


@pytest.mark.parametrize(
    "change", [{"diffusion": 20.0}, {"bends": True}, {"rigid": True}, {"pin": PIN}]
)
def test_what_somebody_says_how_it_bends_is_asked_for_nothing(change: dict[str, object]) -> None:
    scene, poses = frames()
    trunk, wing = scene.bodies
    told = replace(scene, bodies=(replace(trunk, **change), wing))  # type: ignore[arg-type]
    # The wing alone has too few of the triangles.
    assert machine_bodies(told, centred(poses)) == ()
    assert machine_bodies(told, centred(poses), options=MachineOptions(share=0.3, turning=0.0)) == (
        1,
    )


def test_what_never_moves_is_no_part_of_a_machine() -> None:
    scene, poses = frames()
    still = scene.mobility.copy()
    still[scene.vertices_of(0)] = 0.0
    # The wing is all that moves, and has nothing to turn against.
    assert machine_bodies(replace(scene, mobility=still), centred(poses)) == ()


def test_wholes_have_no_contacts_and_joints_of_their_own() -> None:
    scene, _ = frames()
    (reference,) = scene.references
    inside = np.array([[0, 5], [3, 9]], dtype=np.int32)
    both = replace(
        scene,
        references=(reference._replace(pairs=np.concatenate([reference.pairs, inside])),),
    )
    whole = as_wholes(both, [0])
    assert [body.rigid for body in whole.bodies] == [True, False]
    assert np.array_equal(whole.references[0].pairs, reference.pairs)
    assert whole.ignored == ((0, 0),)
    # What of a body bends may still have joints within.
    assert len(as_wholes(both, [1]).references[0].pairs) == len(reference.pairs) + len(inside)


def test_where_nothing_is_attached_nobody_asks() -> None:
    every = [winged(angle, attached=False) for angle in ANGLES]
    poses = [frame for _, frame, _ in every]

    def judge(meshes: WeldedMeshes, own: list[OpenedPose]) -> list[Judged]:
        raise AssertionError("asked")

    assert machine_kept_whole(WeldedMeshes(every[0][0]), poses, judge) is None


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_a_frame_that_keeps_many_pairs_by_itself_ends_it(share: float) -> None:
    scene, poses = frames()
    apart = np.where(scene.body_of_vertex[:, None] == 1, [5.0, 0.0, 0.0], 0.0)
    asked = list[int]()

    def judge(meshes: WeldedMeshes, own: list[OpenedPose]) -> list[Judged]:
        asked.append(len(own))
        return [Judged(pose.centred + apart) for pose in own]

    def left(_: Scene, own: Sequence[OpenedPose], __: Sequence[Judged]) -> list[int]:
        return [int(share * pose.wrong) for pose in own]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(props, "faults_left", left)
        found = machine_kept_whole(WeldedMeshes(scene), poses, judge)
    # What moves far is asked for last whether bending brings it nearer.
    assert (found is None, asked) == ((False, [1, 4, 1]) if share < 0.1 else (True, [1]))


def test_one_frame_is_solved_once() -> None:
    scene, poses = frames()
    worst = max(poses, key=lambda pose: pose.wrong)
    apart = np.where(scene.body_of_vertex[:, None] == 1, [5.0, 0.0, 0.0], 0.0)
    asked = list[int]()

    def judge(meshes: WeldedMeshes, own: list[OpenedPose]) -> list[Judged]:
        # It moves far, and bending it brings it nowhere.
        asked.append(len(own))
        return [Judged(pose.centred + apart) for pose in own]

    assert machine_kept_whole(WeldedMeshes(scene), [worst], judge) is not None
    rigid, bent = 1, 1
    assert len(asked) == rigid + bent


def strained(points: FloatArray) -> Judged:
    excess = Excess(StrainKind.DRIFT, 0, 1.0, 0.2, 0, np.zeros(1, dtype=np.int32))
    return Judged(points, (excess,), lowered=True)


@pytest.mark.parametrize(
    ("alone", "together", "calls"),
    [
        ("clean", "clean", [1, 4]),
        ("clean", "dirty", [1, 4]),
        ("dirty", "clean", [1]),
        ("strained", "clean", [1]),
    ],
)
def test_the_worst_frame_tells_whether_it_is_tried(
    alone: str, together: str, calls: list[int]
) -> None:
    scene, poses = frames()
    asked = list[int]()
    worst = max(poses, key=lambda pose: pose.wrong)
    apart = np.where(scene.body_of_vertex[:, None] == 1, [5.0, 0.0, 0.0], 0.0)

    def judge(meshes: WeldedMeshes, own: list[OpenedPose]) -> list[Judged]:
        if not all(body.rigid for body in meshes.scene.bodies):
            return [Judged(pose.centred + apart) for pose in own]  # no nearer where it bends
        assert len(asked) or own == [worst]
        asked.append(len(own))
        how = alone if len(asked) == 1 else together
        if how == "strained":
            return [strained(pose.centred + apart) for pose in own]
        return [Judged(pose.centred + (how == "clean") * apart) for pose in own]

    found = machine_kept_whole(WeldedMeshes(scene), poses, judge)
    assert asked == calls
    assert (found is not None) == (alone == together == "clean")


@pytest.mark.parametrize(("share", "bends"), [(MachineOptions().share, False), (2.0, True)])
def test_a_machine_is_repaired_without_bending(share: float, bends: bool) -> None:
    """The wing just lies on the trunk: it turns up again as a whole."""
    scene, poses = frames((1.0, 1.03, 1.06))
    parts = [np.split(pose.centred, [scene.vertex_starts[1]]) for pose in poses]
    options = ClipOptions(machine=MachineOptions(share=share))
    clips = ClipRepairer(scene, WeldedMeshes(scene), options=options)
    found = [frame.results for frame in clips.stream(enumerate(parts), jobs=1)]
    assert all(own.status is Status.CLEAN for both in found for own in both)
    assert found[-1][0].before.pairs > 0
    both = zip(parts[-1], found[-1], strict=True)
    bent = max(bent_by(before, own.points) for before, own in both)
    # Results are rounded to single precision.
    assert bent > 1e-4 if bends else bent < 1e-6
