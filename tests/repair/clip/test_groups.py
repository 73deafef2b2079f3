"""Bodies that never meet are repaired as if there were no others, whatever these do."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairResult, SceneRepairer
from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair import independent
from dtrepair.repair.clip import window_repairer
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.sub_scene import SubScene, sub_scene
from dtrepair.repair.scene.welded_mesh import PartMeshes, WeldedMeshes
from dtrepair.repair.strain.bounds import Excess
from tests.meshes import icosphere

BALL, FACES = icosphere(2)
APART = np.array([2.4, 0.1, 0.2])
FAR = np.array([0.0, 40.0, 0.0])
COMES = (0.0, 0.2, 0.5, 0.7, 0.5, 0.2, 0.0)
FLOOR = np.array([[-90.0, -90.0, -1.2], [90.0, -90.0, -1.2], [0.0, 90.0, -1.2]])
PAIR = [Body(BALL, FACES, name="one"), Body(BALL + APART, FACES, name="two")]


def pair(place: float, at: FloatArray | float = 0.0) -> list[FloatArray]:
    """Two balls, the second so far from where it touches nothing."""
    return [BALL + at, BALL + APART - [place, 0.0, 0.0] + at]


def repaired(bodies: list[Body], poses: list[list[FloatArray]]) -> list[list[RepairResult]]:
    stream = SceneRepairer(bodies).animator.stream(
        [(float(time), pose) for time, pose in enumerate(poses)], jobs=1
    )
    return [frame.results for frame in stream]


def same(ours: list[RepairResult], theirs: list[RepairResult]) -> bool:
    return all(np.array_equal(a.points, b.points) for a, b in zip(ours, theirs, strict=True))


def noted_groups(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, ...]]:
    """The groups of bodies that are looked at from now on."""
    asked: list[tuple[int, ...]] = []
    known = WeldedMeshes.of_bodies

    def of_bodies(self: WeldedMeshes, bodies: tuple[int, ...]) -> PartMeshes[SubScene]:
        asked.append(bodies)
        return known(self, bodies)

    monkeypatch.setattr(WeldedMeshes, "of_bodies", of_bodies)
    return asked


ALONE = repaired(PAIR, [pair(place) for place in COMES])


def test_a_pair_far_away_changes_no_bit() -> None:
    others = [Body(points, FACES) for points in pair(0.0, FAR)]
    turned = [*COMES[3:], *COMES[:3]]
    poses = [pair(a) + pair(b, FAR) for a, b in zip(COMES, turned, strict=True)]
    found = repaired([*PAIR, *others], poses)
    assert all(own.status == "clean" for frame in found for own in frame)
    for frame, alone in zip(found, ALONE, strict=True):
        assert same(frame[:2], alone)
    assert not np.array_equal(found[0][2].points, poses[0][2])
    assert [own.before.pairs for own in found[3][:2]] == [own.before.pairs for own in ALONE[3]]


def test_a_floor_changes_no_bit_though_it_holds_nothing() -> None:
    floor = Body(FLOOR, np.array([[0, 1, 2]]), mobility=0.0)
    far = [*pair(0.0), FLOOR - [0.0, 0.0, 9.0]]
    poses = [[*pair(place), far[2]] for place in COMES]
    found = repaired([*PAIR, floor], poses)
    assert all(same(frame[:2], alone) for frame, alone in zip(found, ALONE, strict=True))
    assert all(np.array_equal(frame[2].points, far[2]) for frame in found)
    # One that is near takes part, and measures nothing.
    near = repaired([*PAIR, floor], [[*pair(place), FLOOR] for place in COMES])
    assert all(own.status == "clean" for frame in near for own in frame)
    moved = [np.abs(a.points - b.points).max() for a, b in zip(near[3], ALONE[3], strict=False)]
    assert max(moved) < 0.08


def test_a_hold_does_not_swim_beside_what_moves_elsewhere() -> None:
    held = [*COMES[:4], *[COMES[3]] * 3, *COMES[4:]]
    other = Body(BALL + FAR, FACES)
    poses = [[*pair(place), BALL + FAR + [0.01 * k, 0.0, 0.0]] for k, place in enumerate(held)]
    found = repaired([*PAIR, other], poses)
    assert all(same(found[3][:2], found[k][:2]) for k in range(4, 7))
    assert not np.array_equal(found[3][1].points, poses[3][1])
    assert all(
        np.array_equal(frame[2].points, pose[2]) for frame, pose in zip(found, poses, strict=True)
    )


def test_groups_that_would_meet_are_repaired_together(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def each_alone(scene: Any, poses: Any) -> list[tuple[int, ...]]:
        asked.append(len(poses))
        return [(0,), (1,)]

    monkeypatch.setattr(window_repairer, "groups_of_bodies", each_alone)
    found = repaired(PAIR, [pair(place) for place in COMES])
    assert asked == [len(COMES)]
    assert all(same(frame, alone) for frame, alone in zip(found, ALONE, strict=True))


def test_only_groups_with_faults_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = noted_groups(monkeypatch)
    repaired([*PAIR, Body(BALL + FAR, FACES)], [[*pair(place), BALL + FAR] for place in COMES])
    assert asked == [(0, 1)]
    repaired([*PAIR, Body(BALL + FAR, FACES)], [[*pair(0.0), BALL + FAR]] * 2)
    assert asked == [(0, 1)]


def test_progress_of_groups_adds_up() -> None:
    others = [Body(points, FACES) for points in pair(0.0, FAR)]
    told: list[float] = []
    frames = [(float(k), pair(place) + pair(place, FAR)) for k, place in enumerate(COMES)]
    repairer = SceneRepairer([*PAIR, *others])
    assert len(list(repairer.animator.stream(frames, jobs=1, progress=told.append))) == len(COMES)
    half = [value for value in told if value <= len(COMES) / 2]
    assert half and told[len(half)] > len(COMES) / 2 and max(told) <= len(COMES)
    assert all(after >= before - 1e-9 for before, after in pairwise(told))


def test_what_is_strained_is_told_by_the_numbers_of_the_whole() -> None:
    bodies = [Body(BALL + at, FACES) for at in (0.0 * FAR, FAR, 2.0 * FAR)]
    parts = sub_scene(make_scene(bodies, SceneRepairer(PAIR).options), (0, 2))
    own = Excess(StrainKind.EDGES, 1, 9.0, 5.0, len(BALL) + 3, np.array([4, len(BALL) + 3]))
    whole, inner = np.zeros((3 * len(BALL), 3)), np.ones((2 * len(BALL), 3))
    joined = parts.joined(Judged(whole, lowered=True), Judged(inner, (own,), turned=True))
    assert joined.lowered and joined.turned and joined.points[:, 0].sum() == 2 * len(BALL)
    (found,) = joined.excess
    assert found.part == parts.outer.strain_meter.parts.of_vertex[-1]
    assert (found.worst, found.vertices.tolist()) == (2 * len(BALL) + 3, [4, 2 * len(BALL) + 3])
    assert found._replace(part=1, worst=own.worst, vertices=own.vertices) == own


def test_single_poses_are_repaired_by_groups_too(monkeypatch: pytest.MonkeyPatch) -> None:
    (alone,) = [SceneRepairer(PAIR)(pair(0.5))]
    others = [Body(points, FACES) for points in pair(0.0, FAR)]
    found = SceneRepairer([*PAIR, *others])(pair(0.5) + pair(0.7, FAR))
    assert same(found[:2], alone) and not np.array_equal(found[0].points, BALL)
    assert [own.status for own in found] == ["clean"] * 4
    assert [own.before.pairs for own in found[:2]] == [own.before.pairs for own in alone]
    assert found[0].stages and found[0].iterations > alone[0].iterations
    # A group without a fault is not looked at, and a pose without any not taken apart.
    asked = noted_groups(monkeypatch)
    own = SceneRepairer([*PAIR, *others])(pair(0.5) + pair(0.0, FAR))
    assert same(own[:2], alone) and asked == [(0, 1)]
    SceneRepairer([*PAIR, *others])(pair(0.0) + pair(0.0, FAR))
    assert asked == [(0, 1)]
    # With a clearance a pose without pairs may have to move as well.
    kept = RepairOptions(clearance=0.02)
    SceneRepairer([*PAIR, *others], options=kept)(pair(0.5) + pair(0.0, FAR))
    assert asked == [(0, 1), (0, 1), (2, 3)]


def test_groups_of_a_pose_that_would_meet_are_repaired_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    expected = SceneRepairer(PAIR)(pair(0.5))
    monkeypatch.setattr(independent, "groups_of_bodies", lambda *_: [(0,), (1,)])
    assert same(SceneRepairer(PAIR)(pair(0.5)), expected)
    monkeypatch.setattr(independent, "groups_meet", lambda *_: False)
    assert not same(SceneRepairer(PAIR)(pair(0.5)), expected)
