"""What all that moves was shifted by goes back, as far as nothing that stands still is met."""

from __future__ import annotations

from typing import Any

import numpy as np

from dtrepair import Body, SceneRepairer
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.scale import Scale
from dtrepair.repair.clip.tighten_frames import shift_frames_back
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.full.method import FullMethod
from dtrepair.repair.full.phases import Phases
from dtrepair.repair.full.settle import (
    along_and_across,
    carried_vertices,
    common_shifts,
    leaning,
    shifted_back,
)
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import armed_body, grid, icosphere, joined
from tests.repair.clip.test_settle_frames import window
from tests.repair.full.test_settle import curled

FRAMES = 5
BALL, FLOOR = icosphere(2, 0.5), grid(6, 6, 8.0)
COUNT = len(BALL[0])
UP, ASIDE = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.5, 0.0])
# How deep the ball is in the floor, and how far it was led up and aside.
SUNK, LIFTED, SLID = 0.1, 0.43, 0.2


def ball_and_floor(mobility: float = 1.0, direction: FloatArray | None = None) -> Surface:
    """A ball, and a floor of the set around that never moves."""
    rest, faces = joined(BALL, (FLOOR[0] - FLOOR[0].mean(axis=0), FLOOR[1]))
    free = np.zeros(len(rest))
    free[:COUNT] = mobility
    bodies = [BodyRange(0, COUNT, 99.0), BodyRange(COUNT, len(rest), 99.0)]
    scale = Scale((np.arange(COUNT, dtype=np.int32),))
    return Surface(rest, faces, bodies=bodies, mobility=free, scale=scale, direction=direction)


def sunken(surface: Surface) -> FloatArray:
    """The ball, sunk into the floor (V, 3), units of the surface."""
    pose = surface.rest.copy()
    pose[:COUNT] += (0.5 - SUNK) * UP / surface.size
    return pose


def state_of(
    surface: Surface, original: FloatArray, moved: FloatArray, farthest: float | None = None
) -> WindowState:
    """Frames of one pose (V, 3), displaced by moved (T, V, 3)."""

    def alone(surface: Surface, pose: FloatArray) -> FloatArray:
        return pose

    poses, times = np.repeat(original[None], len(moved), axis=0), np.arange(float(len(moved)))
    state = WindowState(surface, poses, times, WorkerPool(), alone=alone, farthest=farthest)
    state.work.extra[:] = moved
    state.evaluate()
    return state


def led_up(surface: Surface, farthest: float | None = None) -> WindowState:
    moved = np.zeros((FRAMES, surface.count, 3))
    moved[:, :COUNT] = (LIFTED * UP + SLID * ASIDE) / surface.size
    return state_of(surface, sunken(surface), moved, farthest)


def test_a_shift_that_only_contacts_within_it_went_with_goes_back() -> None:
    state, _ = window()
    before, shift = state.poses.copy(), np.array([0.02, 0.03, -0.01])
    state.work.extra += shift
    state.evaluate()
    shift_frames_back(state)
    assert not state.dirty
    # But for that, all is as it was: bending stays, and so does what is too little to be seen.
    assert np.allclose(state.poses, before - [0.0, 2e-4, 0.0], atol=1e-12)
    still = state.poses.copy()
    shift_frames_back(state)
    assert np.array_equal(state.poses, still)


def test_on_a_floor_it_goes_back_along_it_and_down_as_far_as_it_can() -> None:
    surface = ball_and_floor()
    state = led_up(surface)
    assert any(map(len, state.found)) and not state.dirty
    shift_frames_back(state)
    assert not state.dirty
    left = surface.size * (state.poses - state.original)[:, :COUNT]
    assert np.allclose(left[..., :2], 0.0, atol=1e-12)
    # The faint part of a shift stays, and four halvings find a sixteenth of it.
    assert (left[..., 2] > SUNK).all()
    assert (left[..., 2] < SUNK + LIFTED / 16 + 1e-6).all()
    assert np.array_equal(state.poses[:, COUNT:], state.original[:, COUNT:])


def test_what_goes_back_less_in_one_frame_goes_back_smoothly() -> None:
    surface = ball_and_floor()
    moved = np.zeros((15, surface.count, 3))
    moved[:, :COUNT] = LIFTED * UP / surface.size
    state = state_of(surface, sunken(surface), moved)
    state.work.original[:7, :COUNT] += UP / surface.size
    state.work.original[8:, :COUNT] += UP / surface.size
    state.evaluate()
    shift_frames_back(state)
    height = surface.size * (state.poses - state.original)[:, 0, 2]
    assert not state.dirty and height.argmax() == 7
    assert (height[[0, -1]] < 0.25 * height[7]).all()
    assert np.abs(np.diff(height)).max() < 0.4 * height[7]


def test_a_single_pose_goes_back_as_far_unless_something_would_go_too_far() -> None:
    surface = ball_and_floor()
    original, pose = sunken(surface), led_up(surface).poses[0]
    moved = []
    for farthest in (None, 0.2 * LIFTED / surface.size):
        phases = Phases(surface, original, farthest=farthest)
        found = FullMethod(surface, farthest=farthest)._shifted_back(pose, phases)
        moved.append(surface.size * (found - original)[:COUNT])
    assert np.allclose(moved[0][:, :2], 0.0, atol=1e-12)
    assert ((moved[0][:, 2] > SUNK) & (moved[0][:, 2] < 2.0 * SUNK)).all()
    assert np.allclose(moved[1], LIFTED * UP + SLID * ASIDE)


def test_a_part_that_did_not_move_is_not_carried_along() -> None:
    moth = icosphere(1, 0.05)
    rest, faces = joined(BALL, (moth[0] + 2.0 * UP, moth[1]))
    surface = Surface(rest, faces)
    moved = np.zeros((2, surface.count, 3))
    moved[:, :COUNT] = 0.05 * UP
    moved[1, COUNT:] = 0.01 * UP
    original = np.repeat(surface.rest[None], 2, axis=0)
    none = [np.zeros((0, 2), np.int32)] * 2
    (carried,) = carried_vertices(surface, none)
    assert carried.all()
    found = shifted_back(
        surface,
        original,
        original + moved,
        (none, none),
        lambda poses, frames: [none[0] for _ in frames],
        eased=lambda needed: needed,
    )
    assert np.allclose(found[:, :COUNT], original[:, :COUNT])
    assert np.array_equal(found[0, COUNT:], original[0, COUNT:])
    assert np.allclose(found[1, COUNT:] - original[1, COUNT:], -0.04 * UP)


def test_shifts_that_nothing_allows_for_are_left() -> None:
    surface = ball_and_floor()
    pinned = np.zeros((surface.count, 3))
    pinned[:COUNT] = UP
    # Held in part, led in a direction, or beside another body that is free.
    assert carried_vertices(ball_and_floor(mobility=0.5), []) == []
    assert carried_vertices(ball_and_floor(direction=pinned), []) == []
    assert carried_vertices(ball_and_floor(mobility=0.0), []) == []
    both = joined(BALL, (BALL[0] + 0.7 * ASIDE, BALL[1]))
    bodies = [BodyRange(0, COUNT, 99.0), BodyRange(COUNT, 2 * COUNT, 99.0)]
    two = Surface(*both, bodies=bodies)
    met = two.contacts.pairs(two.rest)
    assert leaning(two, met) == {0, 1} and not leaning(two, met[:0])
    assert carried_vertices(two, [met[:0], met]) == []
    # One that meets nothing but itself and the floor leans on nobody.
    assert [own.tolist() for own in carried_vertices(two, [met[:0]])] == [
        [True] * COUNT + [False] * COUNT,
        [False] * COUNT + [True] * COUNT,
    ]
    assert not leaning(surface, surface.contacts.pairs(sunken(surface)))
    # Nor where no vertex may go farther than it has: others would.
    state = led_up(surface, farthest=1.0)
    before = state.poses.copy()
    shift_frames_back(state)
    assert np.array_equal(state.poses, before)


def test_bodies_lean_on_each_other_where_free_ones_meet_or_nothing_is_known() -> None:
    assert not led_up(ball_and_floor()).leaning
    bodies = [BodyRange(0, COUNT, 99.0), BodyRange(COUNT, 2 * COUNT, 99.0)]
    moved = np.zeros((FRAMES, 2 * COUNT, 3))
    for apart in (0.7, 9.0):
        two = Surface(*joined(BALL, (BALL[0] + apart * ASIDE, BALL[1])), bodies=bodies)
        state = state_of(two, two.rest, moved)
        assert any(map(len, state.found)) == (apart < 1.0) and state.leaning
    one = Surface(*BALL)
    assert not state_of(one, one.rest, moved[:, :COUNT]).leaning
    # One of two that lie apart meets what never moves.
    floor = FLOOR[0] - FLOOR[0].mean(axis=0) - (0.5 - SUNK) * UP
    rest, faces = joined(BALL, (BALL[0] + 9.0 * ASIDE, BALL[1]), (floor, FLOOR[1]))
    bodies.append(BodyRange(2 * COUNT, len(rest), 99.0))
    free = np.concatenate([np.ones(2 * COUNT), np.zeros(len(floor))])
    still = Scale((np.arange(2 * COUNT, dtype=np.int32),))
    three = Surface(rest, faces, bodies=bodies, mobility=free, scale=still)
    state = state_of(three, three.rest, np.zeros((FRAMES, len(rest), 3)))
    assert three.clusters > 1 and any(map(len, state.found)) and not state.leaning


def test_what_stands_still_is_not_shifted() -> None:
    surface = ball_and_floor()
    (carried,) = carried_vertices(surface, [])
    assert carried[:COUNT].all() and not carried[COUNT:].any()
    order = np.argsort(surface.rest[:COUNT, 2])
    area = np.cumsum(surface.mass[order]) / surface.mass[:COUNT].sum()
    moved = np.zeros((5, surface.count, 3))
    for frame, still in enumerate((0.05, 0.15, 0.4, 0.0)):
        moved[frame, order[area >= still]] = UP
    moved[4, :COUNT] = 1e-3 * UP
    # All of it with a twentieth of the area still, half with some more; a faint one not at all.
    shares = common_shifts(surface, moved, carried) @ UP
    assert np.allclose(shares, [1.0, 0.5, 0.0, 1.0, 0.0], atol=0.1)


def test_floors_and_walls_at_once_face_no_way() -> None:
    surface = ball_and_floor()
    pose, shifts = sunken(surface), np.array([[1.0, 2.0, 3.0]])
    pairs = surface.contacts.pairs(pose)
    assert np.allclose(
        np.sum(along_and_across(surface, shifts, pose[None], [pairs]), axis=0), shifts
    )
    along, across = along_and_across(surface, shifts, pose[None], [pairs])
    assert np.allclose(along, [[1.0, 2.0, 0.0]]) and np.allclose(across, [[0.0, 0.0, 3.0]])
    # Which way the floor is turned does not matter, nor that some of it is turned over.
    over = surface.faces.copy()
    over[len(BALL[1]) :: 2] = over[len(BALL[1]) :: 2, ::-1]
    surface.faces = over
    assert len(along_and_across(surface, shifts, pose[None], [pairs])) == 2
    wall = pose.copy()
    wall[:, [0, 2]] = pose[:, [2, 0]]
    both = along_and_across(
        surface, np.repeat(shifts, 2, axis=0), np.stack([pose, wall]), [pairs] * 2
    )
    assert len(both) == 1
    assert len(along_and_across(surface, shifts, pose[None], [pairs[:0]])) == 1


def repaired(rest: FloatArray, faces: Any, poses: list[FloatArray], *around: Body) -> FloatArray:
    """The displacements (T, V, 3) of a clip of one body, perhaps with a set around it."""
    frames = [(float(k), [pose, *(own.rest for own in around)]) for k, pose in enumerate(poses)]
    stream = SceneRepairer([Body(rest, faces), *around]).animator.stream(frames, jobs=1)
    found = [frame.results for frame in stream]
    assert all(own.status == "clean" for frame in found for own in frame)
    return np.stack([own[0].points - pose for own, pose in zip(found, poses, strict=True)])


def test_what_curls_above_a_floor_that_it_does_not_touch_stays_there() -> None:
    (rest, faces), poses = curled(0.0), [curled(4.6 - 0.02 * abs(k - 3))[0] for k in range(FRAMES)]
    low = min(pose[:, 2].min() for pose in poses) - 0.005
    floor = Body(FLOOR[0] * 3.0 + [0.0, 0.0, low], FLOOR[1], mobility=0.0, of_set=True)
    moved = repaired(rest, faces, poses, floor)
    assert np.linalg.norm(moved, axis=2).max() > 0.05
    # Pushed without that, all of it went by .02.
    assert np.abs(np.median(moved, axis=1)).max() < 0.004


def test_a_body_does_not_go_back_where_its_finer_arm_would_go_farther() -> None:
    rest, faces = armed_body(0.0)
    moved = repaired(rest, faces, [armed_body(4.0 + 0.05 * k)[0] for k in range(FRAMES)])
    # Else .26.
    assert np.linalg.norm(moved, axis=2).mean() < 0.18
