"""The windows that an animation is solved in, foretold from the motion alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.repair.clip import window_stream
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.frames import read_frames
from dtrepair.repair.clip.layout import Window, frames_to_solve, motions_of, window_layout
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from tests.meshes import icosphere

SIZES = ClipOptions(window=20, overlap=6)


def walk(count: int, cuts: Sequence[int] = (), seed: int = 0) -> list[NDArray[np.float64]]:
    """Poses of a sphere that wobbles, and jumps at cuts."""
    points, _ = icosphere(1)
    generator = np.random.default_rng(seed)
    poses = []
    for k in range(count):
        jump = sum(k >= cut for cut in cuts)
        poses.append(points + 0.01 * generator.random(3) + [1.5 * jump, 0.0, 0.0])
    return poses


@pytest.mark.parametrize(
    ("cuts", "held"),
    [((), 1), ((17,), 1), ((1, 30, 31), 1), ((), 2), ((18,), 2), ((2, 30, 32), 2)],
)
def test_windows_are_those_of_the_stream(
    monkeypatch: pytest.MonkeyPatch, cuts: Sequence[int], held: int
) -> None:
    (points, faces), moving = icosphere(1), walk(75, cuts)
    poses = [moving[k - k % held] for k in range(75)]
    repairer = SceneRepairer([Body(points, faces)], clip=SIZES)
    seen = []

    def window(
        self: object, frames: Any, tail: Any, *, keep: int
    ) -> tuple[list[window_stream.Repaired], list[NDArray[np.float64]]]:
        seen.append((int(frames[0].time), int(frames[-1].time) + 1, len(frames) - keep))
        done = [window_stream.Repaired(frame.time, []) for frame in frames[: len(frames) - keep]]
        return done, [frame.centred for frame in frames[len(frames) - keep :]]

    monkeypatch.setattr(window_stream.WindowStream, "_window", window)
    frames = [(float(k), [pose]) for k, pose in enumerate(poses)]
    done = [frame.time for frame in repairer.animator.stream(frames)]
    assert done == list(range(75))
    layout = window_layout(np.arange(75.0).tolist(), motions_of(poses), options=SIZES)
    assert [(w.start, w.stop, w.end - w.start) for w in layout] == seen
    starts = [frame.time for frame in read_frames(repairer.scene, frames) if frame.starts]
    assert [w.start for w in layout if not w.follows] == starts == [0, *cuts]


def test_layout_of_one_shot() -> None:
    layout = window_layout(np.arange(40.0).tolist(), np.full(39, 0.01), options=SIZES)
    assert layout == [
        Window(0, 20, 14, False),
        Window(14, 34, 28, True),
        Window(28, 40, 40, True),
    ]
    assert window_layout([], np.zeros(0), options=SIZES) == []
    exact = window_layout(np.arange(20.0).tolist(), np.full(19, 0.01), options=SIZES)
    assert exact == [Window(0, 20, 14, False), Window(14, 20, 20, True)]


def test_a_chunk_needs_one_window_before_and_what_tells_a_cut_after() -> None:
    times, motions = np.arange(100.0).tolist(), np.full(99, 0.01)
    assert frames_to_solve(times, motions, (0, 1), options=SIZES) == (0, 21)
    assert frames_to_solve(times, motions, (3, 4), options=SIZES) == (28, 63)
    assert frames_to_solve(times, motions, (5, 7), options=SIZES) == (56, 100)
    motions[19:21] = 0.0  # a hold: what moves next tells
    assert frames_to_solve(times, motions, (0, 1), options=SIZES) == (0, 23)
    motions[19:40] = 0.0
    assert frames_to_solve(times, motions, (0, 1), options=SIZES) == (0, 24)


def test_a_start_that_looks_like_a_cut_is_avoided() -> None:
    # Alone, a fast frame after the first one would look like a cut: nothing was before it.
    times, motions = np.arange(100.0).tolist(), np.full(99, 0.01)
    motions[27:30] = (0.1, 0.1, 0.01)
    assert len(window_layout(times, motions, options=SIZES)) == 7  # no cut
    assert frames_to_solve(times, motions, (3, 4), options=SIZES) == (14, 63)


def cuts_of(motions: Sequence[float]) -> list[int]:
    """Indices of frames after a cut, one frame a unit of time."""
    times = np.arange(len(motions) + 1.0).tolist()
    layout = window_layout(times, np.array(motions), options=ClipOptions())
    return [window.start for window in layout if not window.follows]


@pytest.mark.parametrize("held", [2, 3, 4])
def test_big_steps_of_held_poses_are_no_cuts(held: int) -> None:
    steps = [*[0.0] * (held - 1), 0.08]
    assert cuts_of(steps * 6) == [0]
    # One that is much bigger than those before and after it still is.
    assert cuts_of([*steps * 3, *[0.0] * (held - 1), 0.45, *steps * 3]) == [0, 4 * held]


def test_a_big_step_between_long_holds_is_a_cut() -> None:
    steps = [0.08, *[0.0] * 4]
    assert cuts_of([0.0, *steps * 3]) == [0, 2, 7, 12]
    assert cuts_of([0.01, *[0.0] * 9, 0.08, *[0.0] * 9, 0.01]) == [0, 11]


def test_a_start_from_rest_is_a_cut_only_if_it_stops_at_once() -> None:
    assert cuts_of([*[0.0] * 9, 0.08, 0.08, 0.08]) == [0]
    assert cuts_of([*[0.0] * 9, 0.08, 0.01, 0.01]) == [0, 10]
