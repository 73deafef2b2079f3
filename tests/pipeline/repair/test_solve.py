"""The loop between reading and writing: order, looking ahead, verification of what is written."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.metrics import JitterMeter
from dtrepair.pipeline.repair.solve import FrameRepairer, repair_frames
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.frames import Frame, make_counter, read_frames
from dtrepair.pipeline.stages.sources import Source, open_source
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.bodies import Body
from tests.command_line import CLOSED, OPEN, tube_pose, tube_stage
from tests.present import present


@pytest.fixture
def source(tmp_path: Path) -> Source:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN, CLOSED, OPEN))
    return open_source(str(path), Selection())


@pytest.fixture
def repairer(source: Source) -> FrameRepairer:
    return repairer_of(source, alone=True)


def repairer_of(source: Source, *, alone: bool, clip: ClipOptions | None = None) -> FrameRepairer:
    mesh = source.meshes[0]
    scene = SceneRepairer([Body(mesh.rest, mesh.faces)], clip=clip)
    counter = make_counter(source, mode="both", device="cpu")
    return FrameRepairer(source, scene, counter, alone=alone)


def frames_of(source: Source) -> list[Frame]:
    return list(read_frames(source, source.times))


def replaced(repairer: FrameRepairer, solve: Callable[[float, Any], Any]) -> FrameRepairer:
    """The repairer with another solver: (time, points) -> solution."""

    def all_of_them(poses: Iterator[Any]) -> Iterator[Any]:
        for time, points in poses:
            yield solve(time, points)

    changed: Any = repairer
    changed.solve = all_of_them
    return repairer


def test_order_and_status(source: Source, repairer: FrameRepairer) -> None:
    done = list(repair_frames(frames_of(source), repairer))
    assert [item.frame.time for item in done] == [1, 2, 3, 4, 5]
    assert [item.points[0] is not None for item in done] == [False, True, False, True, False]
    assert {item.record.status for item in done} == {"clean"}


@pytest.mark.parametrize("ahead", [1, 3, 99])
def test_a_solver_may_look_ahead(source: Source, repairer: Any, ahead: int) -> None:
    single = repairer.solve
    longest = []

    def in_windows(poses: Iterator[Any]) -> Iterator[Any]:
        window = []
        for pose in poses:
            window.append(pose)
            if len(window) == ahead:
                longest.append(len(window))
                yield from single(window)
                window = []
        yield from single(window)

    repairer.solve = in_windows
    frames = frames_of(source)
    frames[0] = Frame(1.0, failure="bad")
    frames[3] = Frame(4.0, blocked="/Root/Tube")
    done = list(repair_frames(frames, repairer))
    assert [item.frame.time for item in done] == [1, 2, 3, 4, 5]
    statuses = [item.record.status for item in done]
    assert statuses == ["failed", "clean", "clean", "skipped", "clean"]


def test_frames_are_solved_together_and_steadily(source: Source, repairer: FrameRepairer) -> None:
    frames = frames_of(source)
    jitter = []
    for alone in (True, False):
        repairer.alone = alone
        done = list(repair_frames(frames, repairer))
        assert [item.frame.time for item in done] == [1, 2, 3, 4, 5]
        assert {item.record.status for item in done} == {"clean"}
        meter = JitterMeter()
        for item in done:
            meter.add(item.frame.spaces[0], item.spaces[0])
        jitter.append(meter.value)
    assert jitter[1] < 0.5 * jitter[0]
    assert repairer.warnings == []


@pytest.mark.parametrize("before", [0, 2])
def test_frames_that_cannot_be_solved_together_are_solved_alone(
    source: Source, repairer: Any, before: int
) -> None:
    def stream(poses: Iterator[Any], *, jobs: int, progress: object) -> Iterator[Any]:
        for number, (time, points) in enumerate(poses):
            if number == before:
                next(poses)  # it looked ahead
                raise ArithmeticError("no factor")
            yield SimpleNamespace(time=time, results=repairer.repairer(points))

    repairer.alone = False
    repairer.repairer.make_animator = lambda memory: SimpleNamespace(stream=stream)
    done = list(repair_frames(frames_of(source), repairer))
    assert [item.frame.time for item in done] == [1, 2, 3, 4, 5]
    assert {item.record.status for item in done} == {"clean"}
    assert len(repairer.warnings) == 1
    assert f"frames from {before + 1} are repaired alone: Arith" in repairer.warnings[0]
    assert repairer.alone_from == before + 1


def test_only_unusable_frames(repairer: FrameRepairer) -> None:
    done = list(repair_frames([Frame(1.0, failure="x"), Frame(2.0, blocked="/A")], repairer))
    assert [item.record.status for item in done] == ["failed", "skipped"]


def result_with(points: NDArray[Any]) -> list[RepairResult]:
    """What a solver returns that believes its points are clean."""
    from dtrepair.diagnosis import Status
    from dtrepair.repair.result import Count, RepairResult

    nothing = Count(0, 0)
    return [RepairResult(points, nothing, nothing, 1, Status.CLEAN)]


def test_claims_of_the_solver_are_not_believed(source: Source, repairer: Any) -> None:
    """It returns the intersecting input, slightly shifted, and says clean."""
    repairer.repairer = lambda points: result_with(points[0])
    lying = replaced(repairer, lambda time, points: result_with(points[0] + np.float32(0.5)))
    done = list(repair_frames(frames_of(source), lying))
    assert [item.record.status for item in done][1] == "unchanged"
    assert done[1].points == (None,)
    assert done[1].record.after == done[1].record.before
    assert done[1].record.displacement_max == 0.0


def test_clean_frames_may_move_with_their_neighbours(
    source: Source, repairer: FrameRepairer
) -> None:
    opener = tube_pose(OPEN - 0.1)
    moving = replaced(repairer, lambda time, points: result_with(opener))
    done = list(repair_frames(frames_of(source), moving))
    assert all(np.array_equal(present(item.points[0]), opener.astype(np.float32)) for item in done)
    assert done[0].record.displacement_max > 0
    # But not into an intersection.
    worse = replaced(repairer, lambda time, points: result_with(tube_pose(CLOSED)))
    done = list(repair_frames(frames_of(source)[:1], worse))
    assert done[0].points == (None,) and present(done[0].record.after).pairs == 0


def test_errors_take_the_place_of_a_frame(source: Source, repairer: FrameRepairer) -> None:
    def solve(time: float, points: list[NDArray[Any]]) -> list[RepairResult] | ArithmeticError:
        return ArithmeticError("no") if time == 2 else result_with(points[0])

    done = list(repair_frames(frames_of(source), replaced(repairer, solve)))
    assert done[1].record.status == "failed" and done[1].record.message == "ArithmeticError: no"
    assert isinstance(done[1].error, ArithmeticError)
    assert [item.record.status for item in done][2:3] == ["clean"]


def test_frames_are_forgotten_once_they_are_written(tmp_path: Path) -> None:
    """However long the clip: no more than a window is held, and what is just being checked."""
    window, near = 8, 6.3  # the ends just pass through each other
    source = open_source(str(tube_stage(tmp_path / "a.usda", (OPEN, near))), Selection())
    repairer = repairer_of(source, alone=False, clip=ClipOptions(window=window, overlap=2))
    given, alive, most, changed = frames_of(source), [], 0, 0

    def frames() -> Iterator[Frame]:
        for index in range(24):
            # Each window has a frame that intersects.
            frame = replace(given[index % 6 == 1], time=float(index))
            alive.append(weakref.ref(frame))
            yield frame
            del frame

    for done, item in enumerate(repair_frames(frames(), repairer)):
        assert item.frame.time == done
        changed += item.points[0] is not None
        most = max(most, sum(frame() is not None for frame in alive))
        del item
    assert done == 23 and changed >= 3  # one frame of each window
    assert window <= most <= window + 2 * repairer.workers + 4
