"""Frames that pushing left dirty: solved from the displacements of their neighbours."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dtrepair import Body, RepairOptions
from dtrepair.intersect.detector import find_intersections
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.mend_frames import (
    LendFramesOptions,
    MendFramesOptions,
    _disputed,
    is_stuck,
    lend_frames,
    lend_nearer,
    mend_frames,
)
from dtrepair.repair.clip.push_frames import Phase, PushFramesOptions, push_frames
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.frame.lending import Loan, carried
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.repair.clip.test_clip_repairer import swing
from tests.repair.surface.test_layers import arm, limb, open_sleeve


@pytest.fixture
def state() -> WindowState:
    """Pincers that swing through themselves, nothing done yet."""
    rest, faces, frames = swing()
    surface = Surface(rest, faces)
    times = np.arange(float(len(frames)))
    return WindowState(surface, frames / surface.size, times, WorkerPool(), alone=solve_alone)


def test_displacements_turn_with_the_input() -> None:
    rest, faces, frames = swing()
    surface = Surface(rest, faces)
    pose, moved = frames[0] / surface.size, np.random.default_rng(0).normal(size=rest.shape)
    turn = Rotation.from_rotvec([0.3, -0.9, 0.5])
    away = np.array([1.0, 2.0, 3.0])
    result = carried(surface, pose, turn.apply(pose) + away, moved)
    expected = turn.apply(pose + moved) + away
    assert np.abs(result - expected).max() < 1e-9
    np.testing.assert_array_equal(carried(surface, pose, pose, np.zeros_like(pose)), pose)


def test_all_frames_become_clean_from_the_first_clean_one(state: WindowState) -> None:
    dirty = state.dirty
    assert 0 < len(dirty) < len(state.original)
    lend_frames(state)
    assert not state.dirty
    for frame in dirty:
        pose = state.surface.written(state.poses[frame])
        assert len(find_intersections(pose, state.surface.faces)) == 0
    untouched = np.setdiff1d(np.arange(len(state.original)), dirty)
    assert (state.poses[untouched] == state.original[untouched]).all()


def test_a_window_without_a_clean_frame_begins_where_least_intersects(state: WindowState) -> None:
    worst = state.dirty[len(state.dirty) // 2]
    chosen = slice(worst, worst + 3)
    times = state.frames[chosen]
    inner = WindowState(
        state.surface, state.original[chosen], times, WorkerPool(), alone=solve_alone
    )
    assert len(inner.dirty) == 3
    lend_frames(inner)
    assert not inner.dirty


def test_pushing_is_stuck_where_it_left_many_frames_of_a_skin(state: WindowState) -> None:
    met = len(state.dirty)
    assert is_stuck(state)
    assert is_stuck(state, options=LendFramesOptions(share=(met - 0.5) / met))
    assert not is_stuck(state, options=LendFramesOptions(share=1.0))


@pytest.mark.parametrize(("diffusion", "rigid"), [(99.0, False), (400.0, False), (99.0, True)])
def test_bodies_are_solved_frame_by_frame_unless_one_is_stiff(
    state: WindowState, diffusion: float, rigid: bool
) -> None:
    rest, faces, frames = swing()
    half = len(rest) // 2
    bodies = [BodyRange(0, half, 99.0), BodyRange(half, len(rest), diffusion, rigid=rigid)]
    apart = faces[(faces < half).all(axis=1) | (faces >= half).all(axis=1)]
    surface = Surface(rest, apart, bodies=bodies)
    poses = frames / surface.size
    two = WindowState(surface, poses, state.frames, WorkerPool(), alone=solve_alone)
    assert two.dirty
    soft = diffusion < 300.0 and not rigid
    assert is_stuck(two, options=LendFramesOptions(share=0.0)) == soft


def poked(*, layered: bool = True, direction: FloatArray | None = None) -> WindowState:
    """A finger that pokes through the sleeve of its arm and leaves again, pushed out of it.

    layered: whether it is known that the sleeve lies over the arm.
    """
    bodies = [Body(*limb(0.5), direction=direction), Body(*open_sleeve())]
    scene = make_scene(bodies, RepairOptions())
    surface = WeldedMeshes(scene)([scene.rest_weld]).surface
    assert surface.covering is not None
    if not layered:
        surface.covering = None
    frames = np.repeat(surface.rest[None] * surface.size, 8, axis=0)
    finger = slice(len(arm()[0]), len(limb(0.5)[0]))
    frames[:, finger, 0] -= 0.24 + 0.06 * np.sin(np.linspace(0.0, np.pi, 8))[:, None]
    times = np.arange(8.0)
    state = WindowState(surface, frames / surface.size, times, WorkerPool(), alone=solve_alone)
    assert state.dirty
    push_frames(state)
    return state


@pytest.fixture
def dressed() -> WindowState:
    return poked()


def test_clothes_that_a_push_led_along_are_relaxed(dressed: WindowState) -> None:
    pushed = np.linalg.norm(dressed.poses - dressed.original, axis=2)
    assert lend_nearer(dressed, options=LendFramesOptions(nearer=1.0))
    relaxed = np.linalg.norm(dressed.poses - dressed.original, axis=2)
    assert not dressed.dirty and relaxed.mean() < pushed.mean()


def test_what_does_not_end_nearer_stays_as_it_was_pushed(dressed: WindowState) -> None:
    pushed = dressed.poses.copy()
    assert not lend_nearer(dressed, options=LendFramesOptions(nearer=0.0))
    assert np.abs(dressed.poses - pushed).max() < 1e-12


def test_what_is_no_clothes_or_has_a_direction_is_not_relaxed_alone(state: WindowState) -> None:
    directed = np.tile([1.0, 0.0, 0.0], (len(limb(0.5)[0]), 1))
    for other in (state, poked(layered=False), poked(direction=directed)):
        before = other.poses.copy()
        assert not lend_nearer(other, options=LendFramesOptions(nearer=np.inf))
        assert (other.poses == before).all()


@pytest.mark.parametrize(
    ("lend", "sweeps"),
    [
        (LendFramesOptions(hopeless=0.0, hopeless_after=2, share=0.0), 2),
        (LendFramesOptions(hopeless=0.0, hopeless_after=3, share=0.0), 4),
        (LendFramesOptions(hopeless=1.0, hopeless_after=2, share=0.0), 6),
        (LendFramesOptions(hopeless=0.0, hopeless_after=2, share=1.0), 6),
        (None, 6),
    ],
)
def test_pushing_ends_where_it_is_hopeless(
    state: WindowState,
    monkeypatch: pytest.MonkeyPatch,
    lend: LendFramesOptions | None,
    sweeps: int,
) -> None:
    made: list[float] = []
    # Nothing comes clean.
    monkeypatch.setattr(state, "sweep", lambda kernel, step: made.append(step))
    phases = Phase(0.01, 4, 1.0), Phase(0.01, 2, 1.0)
    push_frames(state, lend=lend, options=PushFramesOptions(phases=phases))
    assert len(made) == sweeps


def test_no_loan_is_made_twice(state: WindowState, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[int, int, float]] = []
    lend = state.lend

    def counted(loans: list[Loan], costs: FloatArray) -> None:
        made.extend((loan.frame, loan.lender, float(costs[loan.lender])) for loan in loans)
        lend(loans, costs)

    monkeypatch.setattr(state, "lend", counted)
    # Whatever differs at all is disputed, in every round.
    lend_frames(state, options=LendFramesOptions(apart=0.0, rounds=6))
    assert made and len(made) == len(set(made))


def test_what_differs_from_a_cheaper_neighbour_is_solved_from_there(state: WindowState) -> None:
    costs = np.full(len(state.original), 0.1)
    costs[3], costs[4] = 0.05, 0.2
    options = LendFramesOptions()
    assert _disputed(state, costs, 0, options) == []
    state.poses[4] += 0.01
    assert _disputed(state, costs, 0, options) == [Loan(4, 3, 0.2)]
    assert _disputed(state, costs, 1, options) == []


def test_a_pose_that_costs_less_is_kept(state: WindowState) -> None:
    lend_frames(state)
    frame = int(np.argmax([len(pairs) for pairs in state.found]))
    before = state.poses[frame].copy()
    costs = np.full(len(state.original), 0.0)
    state.lend([Loan(frame, frame - 1, 0.0)], costs)
    assert (state.poses[frame] == before).all() and costs[frame] == 0.0
    state.lend([Loan(frame, frame - 1, np.inf)], costs)
    assert (state.poses[frame] != before).any() and 0.0 < costs[frame] < np.inf


@pytest.mark.parametrize(("effort", "passes"), [(1e-9, 1), (1e9, 3)])
def test_mending_begins_no_pass_after_its_work(
    state: WindowState, monkeypatch: pytest.MonkeyPatch, effort: float, passes: int
) -> None:
    done = []

    def mend(*given: object, **named: object) -> float:
        done.append(1e6)
        return done[-1]

    monkeypatch.setattr(state, "mend", mend)
    options = MendFramesOptions(widths=(1.0, 0.5, 0.0))
    mend_frames(state, effort=effort, options=options)
    assert len(done) == passes


def test_the_work_of_mending_is_counted(state: WindowState) -> None:
    works = []
    counted = state.mend

    def mend(*given: Any, **named: Any) -> float:
        works.append(counted(*given, **named))
        return works[-1]

    state.mend = mend  # type: ignore[method-assign]
    mend_frames(state, options=MendFramesOptions(widths=(1.0,)))
    # At least one detection of all triangles for each dirty frame.
    assert works[0] > len(state.surface.faces) * sum(len(pairs) > 0 for pairs in state.found)
