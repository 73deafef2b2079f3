"""Poses of a scene at once: the results of each alone, whichever way they are solved."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.full.cure import CureOptions
from dtrepair.repair.full.method import FullOptions
from dtrepair.repair.full.phases import PhaseOptions
from dtrepair.repair.independent_options import IndependentOptions, poses_at_once
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.paper import method as paper
from dtrepair.repair.parallel.process_pool import in_batches
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.result import Solved
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.solution_cache import repair_each
from tests.meshes import bent_tube

REST, FACES = bent_tube(0.1, around=12, along=40, radius=0.08)
POSES = [bent_tube(angle, around=12, along=40, radius=0.08)[0] for angle in (6.4, 1.0, 6.6, 6.5)]


def scene(**options: Any) -> SceneRepairer:
    """The tube as a scene."""
    return SceneRepairer([Body(REST, FACES)], options=RepairOptions(**options))


def assert_same(one: object, other: object) -> None:
    """Results of a pose that agree but for the clock."""
    assert isinstance(one, list) and isinstance(other, list)
    for a, b in zip(one, other, strict=True):
        assert np.array_equal(a.points, b.points)
        assert (a.before, a.after, a.status) == (b.before, b.after, b.status)


@pytest.mark.parametrize("method", ["full", "paper"])
def test_a_batch_is_its_poses_one_by_one(method: str) -> None:
    together = scene(method=method).batch([[pose] for pose in POSES])
    assert [found[0].before.pairs > 0 for found in together] == [True, False, True, True]
    assert np.array_equal(together[1][0].points, POSES[1])
    for pose, found in zip(POSES, together, strict=True):
        assert_same(found, scene(method=method)([pose]))


@pytest.mark.parametrize("jobs", [1, 2])
def test_frames_of_the_published_method_come_in_order_for_any_jobs(jobs: int) -> None:
    frames = [(float(k), [pose]) for k, pose in enumerate(POSES)]
    streamed = [*scene(method="paper").animator.stream(frames, jobs=jobs)]
    assert [frame.time for frame in streamed] == [0.0, 1.0, 2.0, 3.0]
    for pose, frame in zip(POSES, streamed, strict=True):
        assert_same(frame.results, scene(method="paper")([pose]))


def test_a_device_takes_frames_in_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    batch = paper.PaperMethod.batch

    def noted(self: paper.PaperMethod, poses: list[FloatArray]) -> list[Solved]:
        calls.append(len(poses))
        return batch(self, poses)

    monkeypatch.setattr(paper.PaperMethod, "batch", noted)
    repairer = scene(method="paper")
    repairer.poses_at_once = 3
    frames = [(float(k), [pose]) for k, pose in enumerate(POSES)]
    streamed = [frame.results for frame in repairer.animator.stream(frames)]
    poses = [[pose] for pose in POSES]
    each = [*repair_each(repairer.batch, poses, None, jobs=1, at_once=3)]
    assert calls == [2, 1, 2, 1]  # of the first three one is clean
    for one, other in zip(streamed, each, strict=True):
        assert_same(one, other)
        assert one[0].after.pairs < max(one[0].before.pairs, 1)


def test_a_pose_that_cannot_be_used_does_not_spoil_its_batch() -> None:
    broken = POSES[0].copy()
    broken[0, 0] = np.nan
    repairer = scene(method="paper")
    poses = [[POSES[0]], [broken], [POSES[2]]]
    found = [*repair_each(repairer.batch, poses, None, jobs=1, at_once=3)]
    assert isinstance(found[1], ValueError)
    assert_same(found[0], repairer([POSES[0]]))
    assert_same(found[2], repairer([POSES[2]]))


def test_batches_hold_every_item_once() -> None:
    assert [*in_batches(range(7), 3)] == [[0, 1, 2], [3, 4, 5], [6]]
    assert [*in_batches([], 3)] == []


def test_poses_at_once_are_many_on_a_gpu_only() -> None:
    assert scene(method="paper").poses_at_once == scene().poses_at_once == 1
    assert poses_at_once(RepairOptions(method="paper"), "cuda:0") > 1
    assert poses_at_once(RepairOptions(method="full"), "cuda:0") == 1


def test_numbers_of_both_methods_reach_them() -> None:
    # One push and nothing after it; no step at all, as every pose counts as run away.
    phases = PhaseOptions(near=(0,), first_steps=(0.01,), insist_steps=())
    numbers = IndependentOptions(
        full=FullOptions(phases=phases, low_enough=np.inf, cure=CureOptions(rounds=0)),
        paper=paper.PaperOptions(runaway=-1.0),
    )
    results = {
        method: SceneRepairer(
            [Body(REST, FACES)],
            options=RepairOptions(method=method),
            clip=ClipOptions(independent=numbers),
        )([POSES[0]])[0]
        for method in ("full", "paper")
    }
    assert [stage.name for stage in results["full"].stages] == ["push 0", "fill"]
    assert np.array_equal(results["paper"].points, POSES[0])
