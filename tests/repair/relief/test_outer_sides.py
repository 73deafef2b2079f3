"""What a limb and both sides of a thin sleeve have in contact: the outer side is solved first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtrepair import RepairOptions, Status
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair import independent
from dtrepair.repair.clip import window_repairer
from dtrepair.repair.relief.inside_out import (
    OuterSideOptions,
    from_themselves,
    outer_sides_first,
)
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.sub_scene import OuterSides
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.shelled_limb import bent_through, limb, shelled_limb, sleeve

AUTO = RepairOptions()
HALF = len(sleeve(0.0)[0]) // 2
BENDS = (0.9, 1.0, 1.1)


def repairer(*, farthest: float | None = None) -> SceneRepairer:
    options = RepairOptions(maximum_displacement=farthest)
    bodies, shown = shelled_limb()
    return SceneRepairer(bodies, options=options, references=[shown], layer_poses=[shown])


def sides_of(own: SceneRepairer) -> OuterSides:
    known = own.meshes.outer_sides
    assert known is not None
    return known[0]


def opened(own: SceneRepairer, points: list[FloatArray]) -> OpenedPose:
    return detected(own.scene, gathered(own.scene, points))


def as_it_is(meshes: WeldedMeshes, frames: list[OpenedPose]) -> list[Judged]:
    return [Judged(frame.centred) for frame in frames]


def as_given(meshes: WeldedMeshes, frames: list[OpenedPose], *_: object) -> list[OpenedPose]:
    return frames


def test_the_inner_side_is_left_out_and_goes_along() -> None:
    own = repairer()
    sides, pose = sides_of(own), opened(own, bent_through(1.0))
    assert len(sides.scene.rest) == len(own.scene.rest) - HALF
    assert len(sides.scene.faces) < len(own.scene.faces) - HALF
    part = sides.opened(pose)
    np.testing.assert_array_equal(sides.placed(pose.centred, part.centred), pose.centred)
    lifted = part.centred + np.array([0.0, 0.0, 0.3])
    whole = sides.placed(pose.centred, lifted)
    inner = np.arange(HALF, 2 * HALF)
    assert np.linalg.norm(whole[inner] - whole[:HALF], axis=1).max() < 0.03


@pytest.mark.parametrize("clip", [True, False])
def test_what_is_pinned_follows_nothing(clip: bool) -> None:
    (cloth, arm), shown = shelled_limb()
    pin = np.zeros(2 * HALF)
    pin[HALF : HALF + 48] = 1.0
    own = SceneRepairer(
        [replace(cloth, pin=pin), arm], references=[shown], layer_poses=[shown], options=AUTO
    )
    pose = bent_through(1.0)
    frames = own.animator.stream([(0.0, pose), (1.0, pose)], jobs=1)
    found = next(frames)[1] if clip else own(pose)
    held = np.flatnonzero(pin)
    np.testing.assert_array_equal(np.asarray(found[0].points)[held], pose[0][held])


def test_only_what_meets_a_shell_counts() -> None:
    own = repairer()
    sides = sides_of(own)
    pose = opened(own, bent_through(1.0))
    assert sides.pairs_of_shells(pose.pairs) == len(pose.pairs) > 0
    inwards = opened(own, [sleeve(0.3, radius=0.197)[0], limb(0.3)[0]])
    assert sides.pairs_of_shells(inwards.pairs) == len(inwards.pairs) > 0
    assert sides.pairs_of_shells(inwards.pairs[:0]) == 0
    shell, other = own.scene.triangles_of(0), own.scene.triangles_of(1)
    alone = [[shell.start, shell.stop - 1], [other.start, other.stop - 1]]
    assert sides.pairs_of_shells(np.array(alone, dtype=np.int32)) == 0


def test_where_nothing_is_gained_frames_stay_as_they_are() -> None:
    own = repairer()
    frames = [opened(own, bent_through(1.0))]
    (kept,) = outer_sides_first(own.meshes, frames, as_it_is)
    assert kept.begun is None
    loose = SceneRepairer(own.bodies)
    assert outer_sides_first(loose.meshes, frames, as_it_is) is frames
    limited = repairer(farthest=0.1)
    assert limited.meshes.outer_sides is None


def test_few_pairs_of_shells_among_many_are_left_at_that() -> None:
    own = repairer()
    frames = [opened(own, bent_through(bend)) for bend in BENDS]

    def judge(meshes: WeldedMeshes, given: list[OpenedPose]) -> list[Judged]:
        # The outer sides as they were modelled.
        return [Judged(meshes.scene.centred_rest) for _ in given]

    found = outer_sides_first(own.meshes, frames, judge)
    assert all(frame.begun is not None and not frame.begun.wrong for frame in found)
    rare = OuterSideOptions(share=1.1)
    assert outer_sides_first(own.meshes, frames, judge, options=rare) is frames


def test_the_worst_frame_of_a_run_tells_whether_all_of_it_begins_so() -> None:
    """Of eight frames three meet the shell, four do not, and the last does."""
    own = repairer()
    deep, less = (opened(own, bent_through(bend)) for bend in (1.0, 0.9))
    clean = opened(own, [sleeve(0.0)[0], limb(0.0)[0]])
    assert 0 < len(less.pairs) < len(deep.pairs)
    frames = [replace(less), replace(deep), replace(less), *[clean] * 4, replace(deep)]
    asked = list[OpenedPose]()

    def judge(meshes: WeldedMeshes, given: list[OpenedPose]) -> list[Judged]:
        return [Judged(meshes.scene.centred_rest) for _ in given]

    def begun(*left: int) -> list[bool]:
        """Frames that begin so; of a run these are left in the given pose, and where it begins."""
        asked.clear()
        answers = iter(left)

        def told(frame: OpenedPose) -> tuple[int, ...]:
            asked.append(frame)
            return (next(answers),)

        found = outer_sides_first(own.meshes, frames, judge, told)
        return [frame.begun is not None for frame in found]

    assert begun(5, 4, 0) == [True] * 3 + [False] * 5
    assert [frame.begun is not None for frame in asked] == [False, True, False]
    assert asked[0] is frames[1] and asked[2] is frames[7]
    assert begun(5, 5, 1, 0) == [False] * 7 + [True]
    close = [frames[k] for k in (0, 3, 4, 5, 7)]
    together = outer_sides_first(own.meshes, close, judge, lambda frame: (frame.begun is None,))
    assert len(together) == 5 and all(frame.begun is not None for frame in together)


@pytest.mark.parametrize("first", [True, False])
def test_a_clip_comes_clean_by_it(first: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not first:
        monkeypatch.setattr(window_repairer, "outer_sides_first", as_given)
    own = repairer()
    frames = [(float(k), bent_through(bend)) for k, bend in enumerate(BENDS)]
    found = [results for _, results in own.animator.stream(frames, jobs=1)]
    clean = [all(own.status == Status.CLEAN for own in results) for results in found]
    assert all(clean) == first


def test_a_single_pose_comes_clean_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    own, pose = repairer(), bent_through(1.0)
    assert {result.status for result in own(pose)} == {Status.CLEAN}
    monkeypatch.setattr(independent, "outer_sides_first", as_given)
    assert {result.status for result in repairer()(pose)} != {Status.CLEAN}


def test_frames_that_stay_dirty_are_solved_from_themselves() -> None:
    own = repairer()
    pose = opened(own, bent_through(1.0))
    clean = opened(own, [sleeve(0.0)[0], limb(0.0)[0]])
    frames = [replace(pose, begun=clean), pose, replace(pose, begun=clean)]
    judged = [Judged(pose.centred), Judged(pose.centred), Judged(clean.centred)]

    def judge(given: list[OpenedPose]) -> list[Judged]:
        assert [frame.begun for frame in given] == [None]
        return [Judged(clean.centred)]

    found = from_themselves(own.scene, frames, judged, judge)
    assert found[0].points is clean.centred
    assert found[1] is judged[1] and found[2] is judged[2]
    same = from_themselves(own.scene, frames, judged, lambda given: [judged[1]])
    assert same[0] is judged[0]
