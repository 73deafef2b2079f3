"""Frames of attached parts on other ways: which are tried, and what is taken of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.relief.other_ways import OtherWayOptions, on_other_ways, with_turns
from dtrepair.repair.scene import bounds
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.repair.relief.test_relief import winged

# What a stand-in for a solver leaves in each of six frames, way by way.
Left = dict[str, list[tuple[int, int]]]
FRAMES = 6


class Trial:
    """A window of six equal frames whose pairs, and parts inside others, are told by hand.

    left: what is left in each frame at first, and on each way; lowered: whether all are strained;
    farther: how far poses go on a rigid way, length units.
    """

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        left: Left,
        *,
        lowered: bool = False,
        farther: float = 0.0,
    ) -> None:
        scene, frame, _ = winged(1.3)
        self.left, self.farther, self.asked = left, farther, list[tuple[str, list[int]]]()
        self.known: list[tuple[FloatArray, tuple[int, int]]] = []
        self.frames = [replace(frame, centred=frame.centred.copy()) for _ in range(FRAMES)]
        self.meshes = WeldedMeshes(scene)
        self.ways = {
            "rigid": WeldedMeshes(replace(scene)),
            "none": WeldedMeshes(scene),
            "all": WeldedMeshes(scene),
        }
        monkeypatch.setattr(self.meshes, "otherwise", lambda *_: iter([self.ways["rigid"]]))
        monkeypatch.setattr(self.meshes, "creased", (self.ways["none"], self.ways["all"]))
        if "dressed" in left:
            self.ways["dressed"] = WeldedMeshes(replace(scene))
            monkeypatch.setattr(self.meshes, "dressed", self.ways["dressed"])
        if "free" in left:
            # A scene whose garments are held, and one with free ones.
            self.meshes = WeldedMeshes(replace(scene, dressed=True))
            self.ways["free"] = WeldedMeshes(replace(scene))
            monkeypatch.setattr(self.meshes, "otherwise", lambda *_: iter([]))
            monkeypatch.setattr(self.meshes, "creased", ())
            monkeypatch.setattr(self.meshes, "undressed", self.ways["free"])
        monkeypatch.setattr(bounds, "pairs_and_enclosed", self.told)
        self.judged = [self.pose("first", k)._replace(lowered=lowered) for k in range(FRAMES)]

    def place(self, frame: OpenedPose) -> int:
        return next(k for k, own in enumerate(self.frames) if own is frame)

    def pose(self, way: str, place: int) -> Judged:
        """A pose of which is known what is left, and which other ways lead away as a whole."""
        points = self.frames[place].centred + (0.0 if way == "first" else self.farther)
        self.known.append((points, self.left[way][place]))
        return Judged(points)

    def told(self, _: Any, __: OpenedPose, points: FloatArray) -> tuple[int, int]:
        return next(left for own, left in self.known if own is points)

    def run(self, *, most: float = np.inf, **options: Any) -> list[tuple[int, int]]:
        def judge(way: WeldedMeshes, own: list[OpenedPose]) -> list[Judged]:
            name = next(name for name, other in self.ways.items() if other is way)
            places = [self.place(frame) for frame in own]
            self.asked.append((name, places))
            return [self.pose(name, place) for place in places]

        numbers = OtherWayOptions(large=len(self.meshes.scene.faces), farther=np.inf)
        numbers = replace(numbers, **options)
        window = self.meshes, self.frames, self.judged

        def enough() -> bool:
            return len(self.asked) >= most

        self.found, taken = on_other_ways(*window, judge, enough, options=numbers)
        assert taken is self.meshes
        return [self.told(None, self.frames[0], own.points) for own in self.found]


def same(*left: int) -> list[tuple[int, int]]:
    return [(pairs, 0) for pairs in left]


def test_what_a_strained_way_cleaned_leaves_room_for_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, rigid = same(5, 5, 5, 9, 9, 9), same(0, 0, 0, 9, 9, 9)
    left = {"first": first, "rigid": rigid, "none": same(*[0] * 6), "all": same(*[0] * 6)}
    trial = Trial(monkeypatch, left, lowered=True)
    assert trial.run() == same(*[0] * 6)
    assert trial.asked == [("rigid", [0, 1, 2]), ("none", [3, 4]), ("none", [5])]


@pytest.mark.parametrize("most", [0, 1, 2, 3])
def test_no_other_way_begins_where_enough_was_done(
    most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, rigid = same(5, 5, 5, 9, 9, 9), same(0, 0, 0, 9, 9, 9)
    left = {"first": first, "rigid": rigid, "none": same(*[0] * 6), "all": same(*[0] * 6)}
    trial = Trial(monkeypatch, left, lowered=True)
    trial.run(most=most)
    assert len(trial.asked) == most


def test_no_turned_joint_is_left_alone_where_enough_was_done(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Asked(Exception):
        """The meshes in which turned joints are left alone were asked for."""

    def asked(_: WeldedMeshes) -> None:
        raise Asked

    left = dict.fromkeys(("first", "rigid", "none", "all"), same(*[5] * 6))
    trial = Trial(monkeypatch, left, lowered=True)
    monkeypatch.setattr(WeldedMeshes, "turning", property(asked))

    def found(enough: bool) -> list[Judged]:
        return with_turns(trial.meshes, trial.frames, trial.judged, lambda *_: [], lambda: enough)

    assert found(True) is trial.judged
    with pytest.raises(Asked):
        found(False)


def test_the_work_of_a_window_grows_with_its_frames_triangles_and_effort() -> None:
    scene, numbers = winged(1.3)[0], OtherWayOptions(work=100.0, work_a_triangle=2.0)
    once = 100.0 + 2.0 * len(scene.faces)
    assert numbers.enough_work(scene, 1) == once
    assert numbers.enough_work(scene, 6) == 6.0 * once
    harder = replace(scene, options=replace(scene.options, effort=4.0))
    assert numbers.enough_work(harder, 1) == 4.0 * once


def test_a_frame_that_a_strained_way_brought_near_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    first, rigid = same(900, 0, 0, 0, 0, 0), same(30, 0, 0, 0, 0, 0)
    left = {"first": first, "rigid": rigid, "none": same(*[0] * 6), "all": same(*[0] * 6)}
    trial = Trial(monkeypatch, left, lowered=True)
    assert trial.run() == same(*[0] * 6)
    assert trial.asked == [("rigid", [0]), ("none", [0])]


def test_each_frame_takes_what_leaves_least(monkeypatch: pytest.MonkeyPatch) -> None:
    first = [(0, 0), (8, 0), (8, 0), (0, 1), (0, 0), (90, 0)]
    none = [(0, 0), (9, 0), (3, 0), (0, 1), (0, 0), (0, 0)]
    every = [(0, 0), (8, 0), (5, 0), (0, 0), (0, 0), (0, 0)]
    left = {"first": first, "rigid": first, "none": none, "all": every}
    trial = Trial(monkeypatch, left)
    found = trial.run(few=6, probes=6)
    # What is worse or the same is not taken; many pairs are left alone; enclosed parts count.
    assert found == [(0, 0), (8, 0), (3, 0), (0, 0), (0, 0), (90, 0)]
    kept = [own is was for own, was in zip(trial.found, trial.judged, strict=True)]
    assert kept == [True, True, False, False, True, True]
    assert trial.asked == [("none", [1, 2, 3]), ("all", [1, 2, 3])]
    assert trial.run(nearly=100, few=6, probes=6)[-1] == (0, 0)


@pytest.mark.parametrize("helps", [True, False])
def test_a_way_that_helps_no_frame_with_least_left_is_left(
    helps: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, cured = same(9, 7, 8, 9, 6, 0), same(0, 3 if helps else 4, 0, 0, 3 if helps else 4, 0)
    poses = {**dict.fromkeys(("first", "rigid", "all"), first), "none": cured}
    trial = Trial(monkeypatch, poses)
    found = trial.run(few=6, probes=2, helped=0.5)
    # The first two of 7 and 6 are halved, or not quite.
    assert found == (cured if helps else same(9, 4, 8, 9, 4, 0))
    tried = [places for name, places in trial.asked if name == "none"]
    assert tried == ([[1], [4], [0], [2, 3]] if helps else [[1], [4]])


def test_clean_frames_go_no_other_way(monkeypatch: pytest.MonkeyPatch) -> None:
    clean = same(*[0] * 6)
    trial = Trial(monkeypatch, dict.fromkeys(("first", "rigid", "none", "all"), clean))
    assert trial.run() == clean and trial.asked == []


@pytest.mark.parametrize(("farther", "left"), [(0.5, 9), (0.001, 0)])
def test_a_rigid_way_that_goes_much_farther_is_not_taken(
    farther: float, left: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses = {"first": same(*[9] * 6), "rigid": same(*[0] * 6)}
    poses |= dict.fromkeys(("none", "all"), poses["first"])
    trial = Trial(monkeypatch, poses, lowered=True, farther=farther)
    assert trial.run(few=6, farther=2.0, near=0.3) == same(*[left] * 6)


@pytest.mark.parametrize("lowered", [True, False])
def test_strained_frames_are_dressed_and_may_go_far(
    lowered: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, dressed = same(0, 9, 9, 80, 80, 80), same(0, 0, 12, 80, 70, 80)
    poses = {**dict.fromkeys(("first", "rigid", "none", "all"), first), "dressed": dressed}
    trial = Trial(monkeypatch, poses, lowered=lowered, farther=0.5)
    found = same(0, 0, 9, 80, 70, 80) if lowered else first
    # However few are solved again otherwise.
    assert trial.run(few=1, share=0.1, farther=2.0, near=0.3) == found
    assert (("dressed", [1, 2, 3, 4, 5]) in trial.asked) == lowered


@pytest.mark.parametrize("lowered", [True, False])
def test_held_garments_are_freed_where_that_leaves_less(
    lowered: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, free = same(0, 90, 70, 80, 90, 90), same(0, 0, 0, 0, 95, 0)
    trial = Trial(monkeypatch, {"first": first, "free": free}, lowered=lowered, farther=0.5)
    assert trial.run(few=6, probes=2) == same(0, 0, 0, 0, 90, 0)
    # After those with least left.
    assert [own for name, own in trial.asked if name == "free"] == [[2, 3], [1], [4, 5]]


def test_creases_may_lead_far(monkeypatch: pytest.MonkeyPatch) -> None:
    poses = {"first": same(*[9] * 6), "none": same(*[0] * 6), "all": same(*[9] * 6)}
    poses["rigid"] = poses["first"]
    trial = Trial(monkeypatch, poses, farther=0.5)
    assert trial.run(few=6, farther=2.0, near=0.3) == same(*[0] * 6)
