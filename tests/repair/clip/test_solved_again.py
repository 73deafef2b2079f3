"""Frames of attached parts that stay dirty are led apart and solved again, if they are few."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from dtrepair.diagnosis import Status
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.work import add_work
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.clip.layout import CutOptions
from dtrepair.repair.clip.window_method import MakeMethod, WindowSolver
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.relief.other_ways import OtherWayOptions
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.props import MachineOptions
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.separation.starts import Starts
from dtrepair.repair.surface.ties import TieOptions
from tests.repair.relief.test_relief import winged


@pytest.mark.parametrize(
    ("angles", "few", "solved"),
    [
        ((0.8, 0.85, 0.9, 1.3), 0, [4, 1]),  # the wing lies in the trunk in the last frame only
        ((1.15, 1.2, 1.25, 1.3), 4, [4, 4]),  # in all of them
        ((1.3, 1.15, 1.25, 1.3), 1, [4, 1]),  # only the one with least left
        ((0.75, 0.8, 0.85, 0.9), 4, []),
    ],
)
def test_few_dirty_frames_are_solved_again(
    angles: Sequence[float], few: int, solved: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []

    def method(mesh: WeldedMesh) -> WindowSolver:
        def solve(
            original: FloatArray,
            frames: FloatArray,
            pool: WorkerPool,
            inputs: Any = None,
            *,
            unless: Any = None,
        ) -> FloatArray:
            assert unless is None
            asked.append(len(original))
            # At first nothing is solved.
            if len(asked) == 1:
                return original
            return np.stack([solve_alone(mesh.surface, pose, rounds=2) for pose in original])

        return solve

    def otherwise(self: Starts, left: Sequence[IntArray]) -> FloatArray:
        assert len(left) == len(angles)
        return self.led

    monkeypatch.setattr(Starts, "otherwise", otherwise)
    monkeypatch.setattr(WeldedMeshes, "creased", ())
    results = results_of(angles, method, OtherWayOptions(few=few, more=1.0))
    assert asked == solved
    if len(solved) == 2:
        again = 1 if angles[0] > angles[1] else 3
        assert results[again][0].before.pairs > 0
        assert all(result.status is Status.CLEAN for result in results[again])


@pytest.mark.parametrize(
    ("way", "work", "ways"), [(np.inf, 0.0, 2), (0.0, 0.0, 3), (0.0, 4e6, 2), (0.0, 9e6, 1)]
)
def test_what_stays_dirty_goes_the_way_that_shares_other_creases(
    way: float, work: float, ways: int
) -> None:
    """Until solving took as much work as three frames may take."""
    asked: list[tuple[float, int]] = []

    def method(mesh: WeldedMesh) -> WindowSolver:
        creased = mesh.surface.options.ties.creased

        def solve(
            original: FloatArray,
            frames: FloatArray,
            pool: WorkerPool,
            inputs: Any = None,
            *,
            unless: Any = None,
        ) -> FloatArray:
            asked.append((creased, len(original)))
            add_work(work)
            # On other ways than this one the last frame is not solved.
            last = [solve_alone(mesh.surface, original[-1], rounds=2)]
            return np.concatenate([original[:-1], last if creased == way else original[-1:]])

        return solve

    results = results_of((0.75, 0.8, 1.3), method, OtherWayOptions())
    clean = [all(result.status is Status.CLEAN for result in frame) for frame in results]
    assert clean == [True, True, 4e6 > work]
    assert asked == [(TieOptions.creased, 3), (np.inf, 1), (0.0, 1)][:ways]


def results_of(
    angles: Sequence[float], method: MakeMethod, ways: OtherWayOptions
) -> list[list[RepairResult]]:
    """The results of a window of frames whose wing turns by these angles."""
    frames = [winged(angle) for angle in angles]
    scene, cuts = frames[0][0], CutOptions(ratio=np.inf, always=np.inf)
    poses = [np.split(frame.centred, [scene.vertex_starts[1]]) for _, frame, _ in frames]
    options = ClipOptions(cuts=cuts, ways=ways, machine=MachineOptions(share=2.0))
    clips = ClipRepairer(scene, WeldedMeshes(scene), options=options, make_method=method)
    return [frame.results for frame in clips.stream(enumerate(poses), jobs=1)]


@pytest.mark.parametrize(
    ("triangles", "usual", "most"),
    [(0, 8, 16), (15_000, 5, 16), (20_000, 4, 12), (30_000, 3, 8), (10_000_000, 1, 1)],
)
def test_fewer_frames_of_large_scenes_are_solved_again(
    triangles: int, usual: int, most: int
) -> None:
    chosen, left = np.ones(16, dtype=bool), list(range(16, 0, -1))
    options = OtherWayOptions()
    assert options.again(chosen, left, triangles) == [slice(16 - usual, 16)]
    assert options.again(chosen, left, triangles, most=12) == [slice(16 - most, 16)]
