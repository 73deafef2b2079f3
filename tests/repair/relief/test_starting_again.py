"""A strained frame of a clip starts again from its neighbour's correction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.diagnosis import Status
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.relief import borrowing
from dtrepair.repair.relief.borrowing import BorrowingOptions, Merit
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.relief.starting_again import _loans, started_again
from dtrepair.repair.scene.bounds import strain_of
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from tests.meshes import icosphere
from tests.repair.relief.test_relief import winged

BALL, FACES = icosphere(3)
COUNT = len(BALL)
BESIDE = np.array([2.5, 0.0, 0.0])


def clip(
    *distances: float, options: RepairOptions | None = None
) -> tuple[Scene, list[OpenedPose], WeldedMesh]:
    """Two balls so far apart in each frame, which meet below 2; the second one turns as well."""
    scene = make_scene([Body(BALL, FACES), Body(BALL + BESIDE, FACES)], options or RepairOptions())
    frames = []
    for index, distance in enumerate(distances):
        c, s = np.cos(0.1 * index), np.sin(0.1 * index)
        other = BALL @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [distance, 0.0, 0.0]
        frames.append(detected(scene, gathered(scene, [BALL, other])))
    return scene, frames, WeldedMeshes(scene)([frame.weld for frame in frames])


def apart(frame: OpenedPose, by: float) -> FloatArray:
    """The second ball led off."""
    points = frame.centred.copy()
    points[COUNT:] += [by, 0.0, 0.0]
    return points


def crushed(frame: OpenedPose) -> FloatArray:
    """The second ball as flat as paper: nothing meets, and it is strained."""
    points = frame.centred.copy()
    points[COUNT:, 0] = points[COUNT:, 0].max() + 0.01 * points[COUNT:, 0]
    return points


def test_a_strained_frame_takes_the_way_of_its_neighbour() -> None:
    scene, frames, mesh = clip(1.9, 1.88, 1.86)
    found = [apart(frames[0], 0.15), crushed(frames[1]), crushed(frames[2])]
    assert strain_of(scene, frames[1].centred, found[1])
    better = started_again(scene, mesh, frames, found)
    assert better[0] is found[0]
    # Not where it is beyond hope.
    none = started_again(scene, mesh, frames, found, options=BorrowingOptions(hopeless=10.0))
    assert all(own is other for own, other in zip(none, found, strict=True))
    # The third borrows what the second found.
    for frame, points in zip(frames[1:], better[1:], strict=True):
        assert not strain_of(scene, frame.centred, points)
        assert len(frame.pairs) and not len(scene.pairs(points, frame.weld))
        assert np.linalg.norm(points - frame.centred, axis=1).max() < 0.25


@pytest.mark.parametrize(
    ("wrung", "loans"),
    [
        ((0.2, 0.6, 0.2), [(1, 0)]),
        ((0.7, 0.6, 0.2), [(0, 1), (1, 2)]),
        ((0.6, 0.6, 0.6), []),
        ((0.1, 0.4, 0.1), []),
    ],
)
def test_frames_with_a_wrung_limb_start_again(
    wrung: tuple[float, ...], loans: list[tuple[int, int]]
) -> None:
    merits = [Merit(False, 0.0, 0, 0.01, own) for own in wrung]
    options = BorrowingOptions(wrung=0.5)
    assert _loans(merits, [1.0] * 3, frozenset(), 1.6, options) == loans


def test_windows_of_clips_borrow() -> None:
    scene, frames, _ = clip(1.9, 1.88)
    found = [apart(frames[0], 0.15), crushed(frames[1])]

    def method(mesh: WeldedMesh) -> Callable[..., FloatArray]:
        return lambda *_, unless: np.stack([mesh.reduced(points) for points in found])

    window = ClipRepairer(scene, WeldedMeshes(scene), make_method=method)
    repaired = list(window.stream(enumerate(own.given for own in frames), jobs=1))
    assert [own.status for each in repaired for own in each.results] == [Status.CLEAN] * 4
    ball = repaired[1].results[1].points
    assert np.linalg.norm(ball - frames[1].given[1], axis=1).max() < 0.25


def test_nothing_is_borrowed_from_strained_or_dirty_neighbours() -> None:
    scene, frames, mesh = clip(1.9, 1.88)
    for lent in (crushed(frames[0]), frames[0].centred):
        found = [lent, crushed(frames[1])]
        better = started_again(scene, mesh, frames, found)
        assert all(new is old for new, old in zip(better, found, strict=True))


def test_frames_that_touch_nothing_show_no_way() -> None:
    scene, frames, mesh = clip(2.4, 1.88)
    found = [frames[0].centred, crushed(frames[1])]
    assert started_again(scene, mesh, frames, found)[1] is found[1]


def test_a_limit_is_kept() -> None:
    options = RepairOptions(maximum_displacement=0.01)
    scene, frames, mesh = clip(1.9, 1.88, options=options)
    found = [apart(frames[0], 0.15), crushed(frames[1])]
    assert started_again(scene, mesh, frames, found)[1] is found[1]


def test_what_no_neighbour_helps_is_solved_alone_where_that_is_better() -> None:
    scene, frames, mesh = clip(1.9, 1.88, 1.86)
    found = [crushed(frames[0]), apart(frames[1], 0.05), apart(frames[2], 0.2)]
    assert len(scene.pairs(found[1], frames[1].weld))
    asked = []

    def alone(frame: OpenedPose) -> FloatArray:
        asked.append(frame)
        return apart(frame, 0.2)

    better = started_again(scene, mesh, frames, found, alone=alone)
    assert asked == frames[:2] and better[2] is found[2]
    for frame, points in zip(frames[:2], better[:2], strict=True):
        assert np.array_equal(points, apart(frame, 0.2))
    assert started_again(scene, mesh, frames, found, alone=crushed)[0] is found[0]


def test_at_any_cost_no_contact_comes_back() -> None:
    for cost in (False, True):
        scene, frames, mesh = clip(1.3, options=RepairOptions(at_any_cost=cost))
        found, few = crushed(frames[0]), apart(frames[0], 0.695)
        assert 0 < 10 * len(scene.pairs(few, frames[0].weld)) <= len(frames[0].pairs)

        def alone(_: OpenedPose, few: FloatArray = few) -> FloatArray:
            return few

        (better,) = started_again(scene, mesh, frames, [found], alone=alone)
        assert better is (found if cost else few)


def test_attached_parts_that_are_rougher_than_beside_start_again() -> None:
    scene, frame, mesh = winged(1.2)
    (whole,) = relieved_poses(scene, mesh, [frame], [mesh.solve([frame.centred])[0][0]])
    rough = whole.copy()
    far = whole[:, 2] > 0.4
    rough[far, 2] += 0.05 * np.sin(60.0 * whole[far, 0])
    for points in (whole, rough):
        assert not strain_of(scene, frame.centred, points)
        assert not len(scene.pairs(points, frame.weld))
    options = BorrowingOptions(smooth=0.03)
    found = started_again(scene, mesh, [frame, frame], [whole, rough], options=options)
    assert found[0] is whole
    edges = mesh.surface.edges
    own, lent, better = (
        distortion(mesh.reduced(frame.centred), mesh.reduced(points), edges)
        for points in (rough, whole, found[1])
    )
    assert own > 2.0 * lent and better < 1.2 * lent
    found = started_again(scene, mesh, [frame, frame], [whole, whole], options=options)
    assert found[0] is whole and found[1] is whole


def test_free_bodies_that_are_much_rougher_than_beside_start_again() -> None:
    scene, frames, mesh = clip(1.9, 1.88)
    flat = apart(frames[1], 0.3)
    flat[COUNT:, 1] *= 0.8
    found = [apart(frames[0], 0.15), flat]
    assert not strain_of(scene, frames[1].centred, flat)
    better = started_again(scene, mesh, frames, found)
    assert better[0] is found[0]
    edges = mesh.surface.edges
    assert distortion(frames[1].centred, flat, edges) > 0.1
    assert distortion(frames[1].centred, better[1], edges) < 0.03
    options = BorrowingOptions(smooth=0.5)
    assert started_again(scene, mesh, frames, found, options=options)[1] is flat


def test_few_frames_of_many_triangles_start_again(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, frame, mesh = winged(1.2)
    (whole,) = relieved_poses(scene, mesh, [frame], [mesh.solve([frame.centred])[0][0]])
    rough = whole.copy()
    far = whole[:, 2] > 0.4
    rough[far, 2] += 0.05 * np.sin(60.0 * whole[far, 0])
    asked = list[int]()

    def solved(state: object, jobs: int | None) -> list[FloatArray]:
        asked.append(len(state.loans))  # type: ignore[attr-defined]
        return [rough] * asked[-1]

    monkeypatch.setattr(borrowing, "_solved", solved)
    found = [whole, rough, whole, rough, whole, rough]
    count = len(mesh.surface.faces)
    for triangles, most in ((count // 3, 2), (count // 2, 3), (1, 1)):
        asked.clear()
        options = BorrowingOptions(triangles=triangles, stands_out=np.inf)
        started_again(scene, mesh, [frame] * 6, found, options=options)
        assert sum(asked) == most
    # Frames that stand out start again for twice as many triangles.
    bent = whole.copy()
    bent[far, 0] += 0.1 * (whole[far, 2] - 0.4)
    asked.clear()
    options = BorrowingOptions(triangles=1, smooth=np.inf, stands_out=1e-4)
    started_again(
        scene, mesh, [frame] * 6, [whole, bent, whole, bent, whole, whole], options=options
    )
    assert sum(asked) == 2


def bent_wing() -> tuple[Scene, OpenedPose, WeldedMesh, FloatArray, FloatArray]:
    """A frame of attached parts, what is found for it, and the same with a wing bent aside."""
    scene, frame, mesh = winged(1.2)
    (whole,) = relieved_poses(scene, mesh, [frame], [mesh.solve([frame.centred])[0][0]])
    bent, far = whole.copy(), whole[:, 2] > 0.4
    bent[far, 0] += 0.1 * (whole[far, 2] - 0.4)
    return scene, frame, mesh, whole, bent


def test_attached_parts_that_stand_out_between_two_frames_take_their_way() -> None:
    scene, frame, mesh, whole, bent = bent_wing()
    assert not strain_of(scene, frame.centred, bent)
    assert not len(scene.pairs(bent, frame.weld))
    frames = [frame] * 3
    options = BorrowingOptions(smooth=np.inf)
    found = started_again(scene, mesh, frames, [whole, bent, whole], options=options)
    assert found[0] is whole and found[2] is whole
    off = np.linalg.norm(bent - whole, axis=1).max()
    assert np.linalg.norm(found[1] - whole, axis=1).max() < 0.2 * off
    # What was led before is led in a loan, too.
    lead = np.array([0.3, 0.1, 0.0])
    led, leads = [pose + lead for pose in (whole, bent, whole)], np.tile(lead, (3, len(whole), 1))
    found = started_again(scene, mesh, frames, led, leads=leads, options=options)
    assert np.linalg.norm(found[1] - led[0], axis=1).max() < 0.2 * off
    # What comes and goes evenly does not stand out, nor does the first or the last frame.
    on = whole + 1.3 * (bent - whole)
    for poses in ([whole, bent, on], [bent, whole, whole]):
        again = started_again(scene, mesh, frames, poses, options=options)
        assert all(a is b for a, b in zip(again, poses, strict=True))
    options = BorrowingOptions(smooth=np.inf, stands_out=0.1)
    again = started_again(scene, mesh, frames, [whole, bent, whole], options=options)
    assert again[1] is bent


def test_only_frames_that_stand_out_borrow_and_only_from_good_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene, frame, mesh, whole, bent = bent_wing()
    flat = whole.copy()
    flat[:, 1] *= 0.01
    assert strain_of(scene, frame.centred, flat)
    asked = list[int]()

    def solved(state: object, jobs: int | None) -> list[FloatArray]:
        asked.append(len(state.loans))  # type: ignore[attr-defined]
        return [bent] * asked[-1]

    monkeypatch.setattr(borrowing, "_solved", solved)

    def loans(*poses: FloatArray, stands_out: float = 1e-4) -> int:
        asked.clear()
        # Strained frames borrow nothing here by the older rule.
        options = BorrowingOptions(smooth=np.inf, hopeless=0.0, stands_out=stands_out, jump=np.inf)
        started_again(scene, mesh, [frame] * len(poses), list(poses), options=options)
        return sum(asked)

    assert loans(whole, bent, whole) > 0
    assert loans(whole, bent, whole, stands_out=1.0) == 0
    # It goes on, if not by equal steps.
    assert loans(whole, bent, whole + 1.3 * (bent - whole)) == 0
    assert loans(whole, whole, bent, bent) == 0
    # Neither from what is strained or intersects, nor for what is strained.
    assert loans(flat, bent, flat) == 0
    assert len(scene.pairs(frame.centred, frame.weld))
    assert loans(frame.centred, bent, frame.centred) == 0
    assert loans(whole, flat, whole) == 0


@pytest.mark.parametrize("jump", [1e-3, np.inf])
def test_a_run_on_another_way_takes_that_of_the_frames_around_it(jump: float) -> None:
    scene, frame, mesh, whole, bent = bent_wing()
    poses, frames = [whole, bent, bent, bent, whole], [frame] * 5
    options = BorrowingOptions(smooth=np.inf, stands_out=np.inf, jump=jump)
    found = started_again(scene, mesh, frames, poses, options=options)
    assert found[0] is whole and found[-1] is whole
    off = np.linalg.norm(bent - whole, axis=1).max()
    steps = [np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(found)]
    if jump == np.inf:
        assert all(a is b for a, b in zip(found, poses, strict=True))
    else:
        assert max(steps) < 0.3 * off
        assert not any(len(scene.pairs(pose, frame.weld)) for pose in found)
    # Two of them cost more than may be lent, and a run that is too long stays.
    for chosen in (replace(options, triangles=1), replace(options, run=2)):
        again = started_again(scene, mesh, frames, poses, options=chosen)
        assert all(a is b for a, b in zip(again, poses, strict=True))
