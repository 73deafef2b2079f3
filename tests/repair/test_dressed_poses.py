"""Garments of single poses are tied to what they lie over, and which of two results is taken."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.attachments import Attachments
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair import independent
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.result import Solved, Stage
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.single_poses import Found
from dtrepair.repair.strain.bounds import Excess
from tests.repair.separation.test_lifting import ARM, SLEEVE

NO_PAIRS, NO_ZONES = np.zeros((0, 2), dtype=np.int32), np.zeros(0, dtype=np.int64)
CAME_OFF = Excess(StrainKind.WORN, 1, 2.0, 1.0, 0, np.zeros(1, dtype=np.int32))


# What is left on the first way and with garments tied, and whether something came off there; the
# last bounds may have brought back what came off.
@pytest.mark.parametrize(
    ("first", "tied", "excess", "taken"),
    [
        ((0, False), (0, False), (), None),
        ((9, False), (0, False), (), "tied"),
        ((9, False), (9, False), (), "first"),
        ((0, False), (0, False), (CAME_OFF,), "first"),
        ((0, True), (0, False), (), "tied"),
        ((0, True), (3, False), (), "first"),
        ((0, True), (0, True), (), "first"),
    ],
)
def test_garments_are_tied_where_they_came_off_or_something_is_left(
    first: tuple[int, bool],
    tied: tuple[int, bool],
    excess: tuple[Excess, ...],
    taken: str | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions())
    meshes, pose = WeldedMeshes(scene), detected(scene, gathered(scene, [ARM[0], SLEEVE[0]]))
    assert meshes.dressed is not None
    points = [pose.centred + 0.1, pose.centred + 0.2]
    left = {id(points[0]): first, id(points[1]): tied}
    stages = [Stage(name, 0, 0, 0.0, 1, 0.5) for name in ("one", "two")]
    solved = [Solved(*own) for own in zip(points, ([own] for own in stages), strict=True)]
    found = [
        Found(Judged(points[0], excess), NO_PAIRS, solved[0], 1.0),
        Found(Judged(points[1]), NO_PAIRS, solved[1], 1.0),
    ]
    asked: list[bool] = []

    def found_tied(own: Scene, *_: Any, **__: Any) -> list[Found]:
        asked.append(own.dressed)
        return found[1:]

    monkeypatch.setattr(independent, "bounded_poses", found_tied)
    monkeypatch.setattr(independent, "wrong_of", lambda _, __, own: left[id(own)][0])
    monkeypatch.setattr(independent, "came_off", lambda _, __, own: left[id(own)][1])
    result = independent._dressed(scene, meshes, pose, found[0], IndependentOptions())
    assert asked == ([] if taken is None else [True])
    if taken == "tied":
        assert result.judged is found[1].judged and result.seconds > 1.0
        assert result.solved.stages == stages
    else:
        assert result is found[0]


# What is left with garments tied, with free ones and with them after the body, and whether the
# first two are strained.
@pytest.mark.parametrize(
    ("tied", "free", "after", "strained", "taken"),
    [
        ((0, False), (0, False), (0, False), (False, False), ["tied"]),
        ((9, False), (0, False), (0, False), (True, False), ["tied", "free"]),
        ((0, False), (0, False), (0, False), (True, False), ["tied", "free"]),
        ((9, False), (9, False), (0, False), (False, False), ["tied", "free", "tied"]),
        ((0, False), (0, False), (0, False), (True, True), ["tied", "free", "tied"]),
        ((0, True), (0, False), (0, False), (False, False), ["tied", "free"]),
        ((0, True), (0, True), (0, False), (False, False), ["tied", "free", "after"]),
        ((0, True), (0, True), (3, True), (False, False), ["tied", "free", "after", "tied"]),
    ],
)
def test_attached_parts_take_their_garments_along_first(
    tied: tuple[int, bool],
    free: tuple[int, bool],
    after: tuple[int, bool],
    strained: tuple[bool, bool],
    taken: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions())
    meshes, pose = WeldedMeshes(scene), detected(scene, gathered(scene, [ARM[0], SLEEVE[0]]))
    vars(scene)["held"] = Attachments(scene.enclosures.part_of_face, NO_ZONES, scene.garments)
    ways = dict(zip(("tied", "free", "after"), (tied, free, after), strict=True))
    points = {name: pose.centred + k for k, name in enumerate(ways)}
    left = {id(points[name]): own for name, own in ways.items()}
    asked: list[str] = []
    led: list[Found] = []

    def found_by(own: Scene, *_: Any, approach: bool) -> list[Found]:
        assert not approach, "what is left is led in from the rest once, at the end"
        name = "tied" if own.dressed else "free"
        asked.append(name)
        judged = Judged(points[name], (CAME_OFF,) * strained[not own.dressed])
        return [Found(judged, NO_PAIRS, Solved(points[name]), 1.0)]

    def after_bodies(*_: Any, **__: Any) -> FloatArray:
        asked.append("after")
        return points["after"]

    monkeypatch.setattr(independent, "bounded_poses", found_by)
    monkeypatch.setattr(independent, "with_bodies_first", after_bodies)

    def bounded(*own: Any, approach: bool) -> Found:
        assert not approach
        return Found(Judged(own[3]), NO_PAIRS, own[4], 1.0)

    monkeypatch.setattr(independent, "bounded_result", bounded)

    def led_in(_: OpenedPose, found: Found, __: IndependentOptions) -> Found:
        led.append(found)
        return found

    monkeypatch.setattr(independent, "approached", led_in)
    monkeypatch.setattr(independent, "wrong_of", lambda _, __, own: left[id(own)][0])
    monkeypatch.setattr(independent, "came_off", lambda _, __, own: left[id(own)][1])
    (result,) = independent._found_so(scene, meshes, [pose], IndependentOptions())
    tried = list(dict.fromkeys(taken))
    assert asked == tried
    assert result.judged.points is points[taken[-1]]
    assert led == [result]


@pytest.mark.parametrize(
    ("led", "pushed"), [((0, False), False), ((2, False), True), ((9, False), True)]
)
def test_what_follows_the_body_is_taken_if_nothing_is_left_and_else_the_best(
    led: tuple[int, bool], pushed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = make_scene([Body(*ARM), Body(*SLEEVE)], RepairOptions())
    meshes, pose = WeldedMeshes(scene), detected(scene, gathered(scene, [ARM[0], SLEEVE[0]]))
    first, along, both = (pose.centred + shift for shift in (0.1, 0.2, 0.3))
    left = {id(first): (9, False), id(along): led, id(both): (5, False)}
    found = {
        id(own): Found(Judged(own), NO_PAIRS, Solved(own), 1.0) for own in (first, along, both)
    }
    asked: list[str] = []

    def found_pushed(own: Scene, *_: Any, **__: Any) -> list[Found]:
        asked.append("pushed")
        return [found[id(both)]]

    monkeypatch.setattr(independent, "with_bodies_first", lambda *_, **__: along)
    monkeypatch.setattr(independent, "bounded_result", lambda *own, **_: found[id(own[3])])
    monkeypatch.setattr(independent, "bounded_poses", found_pushed)
    monkeypatch.setattr(independent, "wrong_of", lambda _, __, own: left[id(own)][0])
    monkeypatch.setattr(independent, "came_off", lambda _, __, own: left[id(own)][1])
    result = independent._dressed(scene, meshes, pose, found[id(first)], IndependentOptions())
    assert asked == ["pushed"] * pushed
    assert result.judged.points is (both if led[0] == 9 else along)
