"""Held poses: solved as one frame, they do not swim, whatever moves before and after them."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, RepairResult, SceneRepairer
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.frames import Frame, fade_weights, holds_of, read_frames, without_holds
from dtrepair.repair.clip.layout import LayoutOptions
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import detected
from tests.meshes import icosphere

BALL, FACES = icosphere(2)
APART = np.array([2.4, 0.1, 0.2])
BODIES = [Body(BALL, FACES, name="one"), Body(BALL + APART, FACES, name="two")]
SCENE = make_scene(BODIES, RepairOptions())


def clip(places: list[float], *, every: float = 1.0) -> list[tuple[float, list[FloatArray]]]:
    """Two balls, the second so far from where it touches nothing."""
    return [
        (every * index, [BALL, BALL + APART - [place, 0.0, 0.0]])
        for index, place in enumerate(places)
    ]


def frames_of(places: list[float]) -> list[Frame]:
    return [detected(SCENE, frame) for frame in read_frames(SCENE, clip(places))]


def points_of(
    poses: list[tuple[float, list[FloatArray]]], *, clearance: float = 0.0
) -> list[FloatArray]:
    repairer = SceneRepairer(BODIES, options=RepairOptions(clearance=clearance))
    stream = repairer.animator.stream(poses, jobs=1)
    found: list[list[RepairResult]] = [list(frame.results) for frame in stream]
    assert all(own.status == "clean" for frame in found for own in frame)
    return [np.concatenate([own.points for own in frame]) for frame in found]


COMES = [0.0, 0.1, 0.2, 0.35, 0.5, 0.6]
GOES = [0.55, 0.4, 0.25, 0.1, 0.0]


def test_holds_are_runs_of_one_pose() -> None:
    assert holds_of(frames_of([0.0, 0.6, 0.6, 0.6, 0.1, 0.1])) == [
        slice(0, 1),
        slice(1, 4),
        slice(4, 6),
    ]
    assert holds_of(frames_of([0.3])) == [slice(0, 1)]


def test_a_hold_is_one_frame_and_later_ones_move_up() -> None:
    frames = frames_of([0.0, 0.6, 0.6, 0.6, 0.1, 0.1])
    frames = [replace(frame, time=2.5 * frame.time) for frame in frames]
    kept, place = without_holds(frames, longest=2)
    assert [frame.time for frame in kept] == [0.0, 2.5, 5.0] and place == [0, 1, 1, 1, 2, 2]
    assert all(
        np.array_equal(kept[index].original, frame.original)
        for index, frame in zip(place, frames, strict=True)
    )


def test_long_holds_without_a_fault_stay_frames_of_their_own() -> None:
    frames = frames_of([0.6, 0.1, 0.1, 0.1, 0.6])
    assert [frame.wrong > 0 for frame in frames] == [True, False, False, False, True]
    kept, place = without_holds(frames, longest=2)
    assert place == [0, 1, 2, 3, 4] and [frame.time for frame in kept] == [0, 1, 2, 3, 4]
    assert without_holds(frames, longest=3)[1] == [0, 1, 1, 1, 2]


def test_a_pose_that_is_held_does_not_swim() -> None:
    places = [*COMES, *[COMES[-1]] * 6, *GOES]
    found = points_of(clip(places))
    held = found[len(COMES) - 1 : len(COMES) + 6]
    assert all(np.array_equal(held[0], own) for own in held)
    assert not np.array_equal(held[0], np.concatenate(clip(places)[len(COMES)][1]))
    # The others go as if it were not held.
    once = points_of(clip([*COMES, *GOES]))
    for ours, theirs in zip([*found[: len(COMES)], *found[-len(GOES) :]], once, strict=True):
        assert np.array_equal(ours, theirs)


def test_a_pose_that_is_held_too_close_does_not_swim() -> None:
    places = [0.0, 0.15, *[0.3] * 7, 0.15, 0.0]
    assert all(frame.wrong == 0 for frame in frames_of(places))
    found = points_of(clip(places), clearance=0.2)
    assert not np.array_equal(found[2], np.concatenate(clip(places)[2][1]))
    assert all(np.array_equal(found[2], own) for own in found[2:9])


def test_of_a_pose_without_a_fault_four_frames_are_one() -> None:
    assert ClipOptions().longest_hold == 4


@pytest.mark.parametrize("frames", [2, 3])
def test_a_clip_in_steps_is_the_clip_of_its_poses(frames: int) -> None:
    places = [*COMES, *GOES]
    stepped = points_of(clip([place for place in places for _ in range(frames)]))
    once = points_of(clip(places, every=float(frames)))
    for index, points in enumerate(stepped):
        assert np.array_equal(points, once[index // frames])


def test_weights_of_a_fade_are_the_same_throughout_a_hold() -> None:
    moving = fade_weights(frames_of([0.01 * index for index in range(9)]), 8)
    part = np.arange(8) / 8.0
    assert moving == pytest.approx(part * part * (3.0 - 2.0 * part))
    within = fade_weights(frames_of([0.0, 0.1, 0.2, 0.2, 0.2, 0.3, 0.4, 0.5, 0.6]), 8)
    assert within[2] == within[3] == within[4] == pytest.approx(moving[2:5].mean())
    assert np.array_equal(np.delete(within, [2, 3, 4]), np.delete(moving, [2, 3, 4]))


def test_a_hold_that_goes_on_beyond_a_fade_is_of_one_window() -> None:
    later = fade_weights(frames_of([0.0, 0.1, 0.2, 0.3, 0.4, 0.4, 0.4]), 5)
    assert later[4] == 1.0 and 0.0 < later[1] < later[3] < 1.0
    before = fade_weights(frames_of([0.4, 0.4, 0.4, 0.3, 0.2, 0.1]), 5)
    assert (before[:3] == 0.0).all() and before[3] > 0.0
    # One that fills all of it has to go from one window to the next.
    throughout = fade_weights(frames_of([0.4] * 6), 5)
    assert throughout[0] == 0.0 and (np.diff(throughout) > 0.0).all()


def test_a_hold_longer_than_a_window_swims_only_from_one_to_the_next() -> None:
    sizes = LayoutOptions()
    count = 2 * sizes.window
    found = points_of(clip([*COMES, *[COMES[-1]] * count, *GOES]))
    held = found[len(COMES) - 1 : len(COMES) + count]
    changes = [not np.array_equal(one, other) for one, other in itertools.pairwise(held)]
    assert sum(changes) <= 2 * (sizes.overlap + 1)
    assert max(np.abs(one - other).max() for one, other in itertools.pairwise(held)) < 0.05
