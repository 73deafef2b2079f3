"""Windows of attached parts begin with frames solved alone: alike in time, and still clean."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, SceneRepairer
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import gaussian_kernel
from dtrepair.pipeline import Cancelled, repair_stage
from dtrepair.repair.clip import window_repairer, window_stream
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.full.biharmonic_fill import FillOptions
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.push import PushOptions
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.separation.starts import Starts
from dtrepair.repair.surface.surface import Surface
from tests.meshes import icosphere, joined, tube
from tests.pipeline.hosts import Listener
from usd_io import AuthoredMesh, write_animation

FRAMES = 7
NEEDED = 0.12


def scene() -> tuple[Surface, FloatArray, slice]:
    """Two attached tubes and a ball beside them; frames with the ball in the tube; the ball."""
    first = tube(12, 20, 0.2, 2.0)
    second = (1.1 * first[0] * (1.0, 1.0, 1.0 / 1.1) + (0.04, 0.01, 1.7), first[1])
    ball = icosphere(2, 0.15)
    beside = (ball[0] + [0.5, 0.0, 0.0], ball[1])
    points, faces = joined(first, second, beside)
    pairs = Detector(points, faces)(points)
    surface = Surface(
        points, faces, attachments=find_attachments(faces, len(points), [Reference(points, pairs)])
    )
    own = slice(len(points) - len(ball[0]), len(points))
    frames = np.repeat(surface.rest[None], FRAMES, axis=0)
    frames[:, own, 0] -= 0.2 / surface.size
    frames[:, own, 2] += 0.05 * np.arange(FRAMES)[:, None] / surface.size
    return surface, frames, own


def solved(ways: Sequence[float]) -> tuple[FloatArray, WindowState]:
    """How far along x the ball goes in each frame (T,) if `ways` (T,) is found for them alone."""
    surface, frames, own = scene()
    kernel = gaussian_kernel(np.arange(FRAMES, dtype=float), 1.5)

    def alone(_: Surface, pose: FloatArray) -> FloatArray:
        frame = int(np.abs(frames - pose).max(axis=(1, 2)).argmin())
        result = pose.copy()
        result[own, 0] += ways[frame]
        return result

    state = WindowState(surface, frames, np.arange(FRAMES, dtype=float), WorkerPool(), alone=alone)
    assert state.dirty == list(range(FRAMES))
    state.solve_alone(kernel, 0.002)
    return (state.poses - frames)[:, own, 0].mean(axis=1), state


def test_frames_that_are_alike_keep_what_was_found() -> None:
    way, state = solved([NEEDED] * FRAMES)
    assert not state.dirty
    assert way == pytest.approx(NEEDED, rel=1e-6)


def test_a_frame_that_went_far_takes_what_its_neighbours_found() -> None:
    way, state = solved([NEEDED, NEEDED, NEEDED, 4.0 * NEEDED, NEEDED, NEEDED, NEEDED])
    assert not state.dirty
    assert way.max() < 1.3 * NEEDED


@pytest.mark.parametrize("dirty", [0, 3, 6])
def test_a_frame_that_stayed_dirty_takes_what_a_neighbour_found(dirty: int) -> None:
    """However far that is: the frame itself went nowhere."""
    ways = [0.0 if frame == dirty else NEEDED for frame in range(FRAMES)]
    _, state = solved(ways)
    assert not state.dirty
    assert [state.work.left(state.surface, pose) for pose in state.work.cold] == [0] * FRAMES


def test_unlike_ways_go_over_into_each_other() -> None:
    ways = np.array([1.0, 1.0, 1.0, 1.0, 1.2, 1.2, 1.2]) * NEEDED
    way, state = solved(list(ways))
    assert not state.dirty
    assert np.abs(np.diff(way)).max() < 0.75 * np.abs(np.diff(ways)).max()


def test_what_smoothing_closes_goes_back_to_what_was_found_alone() -> None:
    # Every other frame has found too little, and keeps its pairs: no frame gets more of them.
    ways = [NEEDED, 0.0, NEEDED, 0.0, NEEDED, 0.0, NEEDED]
    _, state = solved(ways)
    assert not {0, 2, 4, 6} & set(state.dirty)


@pytest.mark.parametrize("jobs", [1, 2])
def test_windows_of_attached_parts_tell_how_far_they_are(tmp_path: Path, jobs: int) -> None:
    """One window holds all frames: all that is told before the first comes from within it."""
    surface, frames, _ = scene()
    poses = list(frames * surface.size)
    path, host = tmp_path / "a.usda", Listener()
    mesh = AuthoredMesh("/Hero/Body", surface.faces, points=poses, rest=surface.rest * surface.size)
    write_animation(path, mesh, times=np.arange(1.0, FRAMES + 1.0))
    report = repair_stage(path, tmp_path / "b.usda", jobs=jobs, observer=host)
    assert report.attached and all(frame.status == "clean" for frame in report.frames)
    assert host.done == sorted(host.done) and host.done[-1] == FRAMES
    within = sorted({done for done in host.done if done % 1.0})
    steps = np.diff([0.0, *within, FRAMES])
    # Relaxing may end some cycles early.
    assert len(within) > 2 * FRAMES / jobs and steps.max() < 0.5 * FRAMES
    cancelled = Listener(within=0.1 * FRAMES)
    with pytest.raises(Cancelled):
        repair_stage(path, tmp_path / "c.usda", jobs=jobs, observer=cancelled)
    assert cancelled.done[-1] < 0.5 * FRAMES


def test_frames_that_stay_dirty_are_not_solved_alone_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The window solved them each for itself; doing so again would cost as much and find the same.

    Without attached parts the window pushes all frames together, and it is another attempt.
    """
    asked: list[bool] = []
    as_poses: list[bool] = []

    def not_mended(*given: Any, alone: object, **_: object) -> tuple[Judged, IntArray]:
        asked.append(alone is not None)
        return given[3], given[4]

    def not_again(*given: Any, leads: FloatArray, alone: object, **_: object) -> list[FloatArray]:
        as_poses.append(alone is not None)
        assert leads == pytest.approx(0.5)
        return list(given[3])

    monkeypatch.setattr(window_stream, "mended", not_mended)
    monkeypatch.setattr(window_repairer, "started_again", not_again)
    monkeypatch.setattr(Starts, "unlifted", lambda starts, _: starts.inputs + 0.5)
    (trunk, faces), ball = tube(12, 20, 0.2, 2.0), icosphere(2, 0.15)
    lower = 1.1 * trunk * (1.0, 1.0, 1.0 / 1.1) + (0.04, 0.01, 1.7)
    bodies = [Body(trunk, faces), Body(lower, faces), Body(*ball)]
    rest, every = joined((trunk, faces), (lower, faces), (ball[0] + [0.5, 0.0, 0.0], ball[1]))
    reference = Reference(rest, Detector(rest, every)(rest))
    no_fill, no_push = FillOptions(rounds=0), PushOptions(iterations=0)
    unmended = ClipOptions(mend=MendOptions(near=(0,), push=no_push, fill=no_fill))
    for references in ([reference], []):
        asked.clear()
        as_poses.clear()
        repairer = SceneRepairer(bodies, references=references)

        def idle(_: WeldedMesh) -> Callable[..., FloatArray]:
            return lambda poses, *_, unless: poses

        meshes = repairer.meshes
        window = ClipRepairer(repairer.scene, meshes, options=unmended, make_method=idle)
        pose = [trunk, lower, ball[0] + [0.2, 0.0, 0.3]]
        assert len(list(window.stream([(1.0, pose), (2.0, pose)], jobs=1))) == 2
        assert asked == 2 * [not references] and as_poses[0] == (not references)
