"""A correction that strains a joint is relaxed until it does not, and its contacts stay open."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, SceneRepairer
from dtrepair.diagnosis import Status, StrainKind
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.work import work_done
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.full.relax import RelaxOptions
from dtrepair.repair.relief import relief
from dtrepair.repair.relief.relief import ReliefOptions, relieved_poses
from dtrepair.repair.scene.bounds import Judged, bounded_pose
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.props import with_rigid
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.strain.bounds import Excess, StrainOptions
from tests.meshes import joined, tube


def winged(
    angle: float, *, attached: bool = True, flat: int = 0
) -> tuple[Scene, OpenedPose, WeldedMesh]:
    """A trunk with a wing whose root ends in it, turned until the wing lies on the trunk.

    flat: so many triangles of the trunk are without area, and no part of what is solved.
    """
    trunk, (points, faces) = tube(14, 24, 0.25, 2.0), tube(12, 20, 0.1, 1.6)
    wing = (points * (1.0, 0.35, 1.0))[:, [2, 1, 0]] * (1.0, 1.0, -1.0) + (0.95, 0.0, 0.0)
    seam = np.tile(np.array([[0, len(trunk[0]), 1]], dtype=np.int32), (flat, 1))
    trunk = np.concatenate([trunk[0], trunk[0][:1]]), np.concatenate([seam, trunk[1]])
    rest, every = joined(trunk, (wing, faces))
    references = [Reference(rest, Detector(rest, every)(rest))] if attached else []
    scene = make_scene([Body(*trunk), Body(wing, faces)], RepairOptions(), references=references)
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    pivot = np.array([0.2, 0.0, 0.0])
    frame = detected(scene, gathered(scene, [trunk[0], (wing - pivot) @ turn + pivot]))
    return scene, frame, WeldedMeshes(scene)([frame.weld])


def pairs_of(scene: Scene, frame: OpenedPose, points: FloatArray) -> IntArray:
    return scene.pairs(points, frame.weld)


@pytest.mark.parametrize("angle", [1.4, 1.6])
def test_a_strained_joint_comes_together_and_its_contacts_stay_open(angle: float) -> None:
    scene, frame, mesh = winged(angle)
    found = mesh.solve([frame.centred])[0][0]
    assert len(frame.pairs) and not len(pairs_of(scene, frame, found))
    assert scene.strain_meter(frame.centred, found)
    # The share within the bounds would bring contacts back.
    none = np.zeros((0, 2), dtype=np.int32)
    lowered, left = bounded_pose(
        scene, frame, Judged(found), none, lambda points: pairs_of(scene, frame, points)
    )
    assert lowered.excess and len(left)
    (relieved,) = relieved_poses(scene, mesh, [frame], [found])
    assert not scene.strain_meter(frame.centred, relieved)
    assert not len(pairs_of(scene, frame, relieved))


def test_where_only_what_is_rigid_moved_nothing_is_relaxed() -> None:
    scene, frame, _ = winged(1.6)
    scene = with_rigid(scene, [0, 1])
    moved = frame.centred.copy()
    moved[scene.vertices_of(1)] += [0.2, 0.0, 0.0]
    assert scene.strain_meter(frame.centred, moved)
    (found,) = relieved_poses(scene, WeldedMeshes(scene)([frame.weld]), [frame], [moved])
    assert np.array_equal(found, moved)


def test_triangles_without_area_are_no_obstacle() -> None:
    for flat in (0, 400):
        scene, frame, mesh = winged(1.6, flat=flat)
        found = mesh.solve([frame.centred])[0][0]
        (relieved,) = relieved_poses(scene, mesh, [frame], [found])
        assert not scene.strain_meter(frame.centred, relieved)


def test_a_pose_with_pairs_left_is_relieved_and_gets_no_more() -> None:
    scene, frame, mesh = winged(1.6)
    found = mesh.solve([frame.centred])[0][0]
    # The tip of the wing is back in the trunk, and the joint as strained as before.
    away = np.abs(frame.centred[:, 2])
    share = np.clip(2.0 - away / 0.6, 0.4, 1.0)[:, None]
    mixed = frame.centred + share * (found - frame.centred)
    left = len(pairs_of(scene, frame, mixed))
    assert left and scene.strain_meter(frame.centred, mixed)
    (relieved,) = relieved_poses(scene, mesh, [frame], [mixed])
    assert not scene.strain_meter(frame.centred, relieved)
    assert len(pairs_of(scene, frame, relieved)) <= left


def test_a_limit_of_displacements_holds() -> None:
    scene, frame, mesh = winged(1.35)
    found = mesh.solve([frame.centred])[0][0]
    (free,) = relieved_poses(scene, mesh, [frame], [found])
    limit = float(np.linalg.norm(found - frame.centred, axis=1).max())
    assert np.linalg.norm(free - frame.centred, axis=1).max() > limit
    limited = replace(scene, options=replace(scene.options, maximum_displacement=limit))
    (relieved,) = relieved_poses(limited, mesh, [frame], [found])
    assert np.linalg.norm(relieved - frame.centred, axis=1).max() <= limit


def test_a_pose_ends_clean() -> None:
    scene, frame, _ = winged(1.5)
    results = SceneRepairer(scene.bodies, references=scene.references)(frame.given)
    assert [result.status for result in results] == [Status.CLEAN] * 2


def test_frames_of_a_window_are_relieved() -> None:
    scene, frame, mesh = winged(1.5)
    points = mesh.solve([frame.centred])[0][0]
    (relieved,) = relieved_poses(scene, mesh, [frame], [points])
    found = mesh.reduced(points)

    def method(_: WeldedMesh) -> Callable[..., FloatArray]:
        return lambda poses, *_, unless: np.repeat(found[None], len(poses), axis=0)

    window = ClipRepairer(scene, WeldedMeshes(scene), make_method=method)
    for repaired in window.stream([(time, frame.given) for time in (1.0, 2.0)], jobs=1):
        result = np.concatenate([own.points for own in repaired.results])
        assert np.abs(result - relieved).max() < 1e-6


@pytest.mark.parametrize("cycles", [0, 1])
def test_what_is_within_the_bounds_or_not_attached_keeps_every_bit(cycles: int) -> None:
    options = ReliefOptions(cycles=cycles)
    for attached in (True, False):
        scene, frame, mesh = winged(1.2, attached=attached)
        found = mesh.solve([frame.centred])[0][0]
        if not attached:
            found = frame.centred + 9.0 * (found - frame.centred)
        assert relieved_poses(scene, mesh, [frame], [found], options=options)[0] is found


def test_what_slides_is_brought_near_though_it_is_not_strained() -> None:
    """Relief aims at a little less than may be."""
    scene, frame, mesh = winged(1.6)
    found, before = mesh.solve([frame.centred])[0][0], frame.centred
    options = StrainOptions(slide=1e-6, drift=1.0, joint=1.0)
    (slid,) = replace(scene, strain=options).strain_meter(before, found)
    own = replace(scene, strain=replace(options, slide=slid.value / 0.92))
    meter = own.strain_meter
    assert not meter(before, found) and meter(before, found, strict=True)
    relieved = relieved_poses(own, mesh, [frame], [found])[0]
    assert not meter(before, relieved, strict=True)
    assert not len(pairs_of(own, frame, relieved))


@pytest.mark.parametrize(("left", "ways"), [((False, 1.2), 1), ((True, 1.2), 2), ((False, 0.0), 1)])
def test_only_what_stays_strained_is_led_a_second_way(
    left: tuple[bool, float], ways: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, frame, mesh = winged(1.6)
    found, led = mesh.solve([frame.centred])[0][0], list[list[float]]()

    def led_to(state: relief.Relief, *known: Any) -> tuple[FloatArray, tuple[bool, float]]:
        led.append(known[2])
        return found, left

    monkeypatch.setattr(relief.Relief, "_led", led_to)
    monkeypatch.setattr(relief.Relief, "_strain", lambda *_: (True, 2.0))
    relieved_poses(scene, mesh, [frame], [found])
    assert led == [list(hold) for hold in ReliefOptions.hold[:ways]]


@pytest.mark.parametrize("spoils", [False, True])
def test_what_is_within_the_bounds_stays_there(
    spoils: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Less drift of what the input let go is nothing worth where it strains another joint."""
    scene, frame, mesh = winged(1.6)
    found = mesh.solve([frame.centred])[0][0]
    drift = Excess(StrainKind.DRIFT, 0, 2.0, 1.0, 0, np.zeros(1, dtype=np.int32))

    def judged(
        _scene: Scene, _before: FloatArray, points: FloatArray, *, strict: bool = False
    ) -> tuple[Excess, ...]:
        if strict:
            return (drift if points is found else drift._replace(value=1.5),)
        return (drift._replace(kind=StrainKind.SLIDE),) * (spoils and points is not found)

    monkeypatch.setattr(relief, "strain_of", judged)
    assert (relieved_poses(scene, mesh, [frame], [found])[0] is found) == spoils


def test_what_still_gains_goes_on() -> None:
    """A wing that swelled comes back by many short steps."""
    scene, frame, mesh = winged(1.2)
    swollen = frame.centred.copy()
    swollen[scene.vertex_starts[1] :, 1] *= 5.0
    assert scene.strain_meter(frame.centred, swollen)
    short = RelaxOptions(step=0.003, first=1.0, longer=1.0, tries=10)
    (relieved,) = relieved_poses(
        scene, mesh, [frame], [swollen], options=ReliefOptions(relax=short)
    )
    assert not scene.strain_meter(frame.centred, relieved)


def test_the_effort_bounds_the_work() -> None:
    scene, frame, mesh = winged(1.6)
    found = mesh.solve([frame.centred])[0][0]
    # A pull that brings nothing together goes through all cycles.
    vain = ReliefOptions(hold=((1e-9,),), patience=10, cycles=10)
    spent = []
    for effort in (1e-9, 1.0):
        limited = replace(scene, options=replace(scene.options, effort=effort))
        start = work_done()
        relieved_poses(limited, mesh, [frame], [found], options=vain)
        spent.append(work_done() - start)
    assert 0 < spent[0] < 0.5 * spent[1]
