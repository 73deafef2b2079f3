"""The published method of a surface: one pose, many poses, on the CPU and as a device runs it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dtrepair.device import DeviceQueue
from dtrepair.intersect.detector import Detector
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.paper.descent import DescentResult
from dtrepair.repair.paper.diffusion import Diffusion
from dtrepair.repair.paper.gpu_descent import DeviceDescent
from dtrepair.repair.paper.method import PaperMethod
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import bent_tube, icosphere, overlapping_spheres

OPTIONS = RepairOptions(method="paper", iterations=60)


def tube() -> tuple[Surface, list[NDArray[np.float64]]]:
    """A straight tube and two poses of it that cross themselves."""
    rest, faces = bent_tube(0.1, around=16, along=60, radius=0.08)
    surface = Surface(rest, faces)
    angles = (6.5, 6.7)
    return surface, [
        bent_tube(a, around=16, along=60, radius=0.08)[0] / surface.size for a in angles
    ]


def test_poses_at_once_are_those_one_by_one() -> None:
    surface, poses = tube()
    method = PaperMethod(surface, OPTIONS)
    for pose, solved in zip(poses, method.batch(poses), strict=True):
        assert len(surface.contacts.pairs(pose)) > 0
        assert np.array_equal(solved.points, method(pose).points)
        assert len(surface.contacts.pairs(solved.points)) == solved.stages[0].crossings < 20


@pytest.mark.parametrize("queue", [None, DeviceQueue("cpu")], ids=["cpu", "device"])
def test_a_pose_that_the_loop_found_clean_is_not_looked_at_again(
    queue: DeviceQueue | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    surface, (shallow, deep) = tube()
    method = PaperMethod(surface, replace(OPTIONS, iterations=1), queue=queue)
    solve, find = method.descent, Detector.__call__
    detected: list[int] = []
    assert solve is not None

    def counted(detector: Detector, points: Any, **given: Any) -> Any:
        detected.append(len(points))
        return find(detector, points, **given)

    def watched(poses: torch.Tensor) -> DescentResult:
        result = solve(poses)
        monkeypatch.setattr(Detector, "__call__", counted)
        return result

    method.descent = watched
    left = [done.stages[0].crossings for done in method.batch([surface.rest, deep, shallow])]
    assert detected == [2] and left[0] == 0 and min(left[1:]) > 0


def test_a_body_without_area_takes_part() -> None:
    ball, faces = icosphere(1)
    needle = np.array([[0.1, 0.0, -2.0], [0.2, 0.05, 0.0], [0.3, 0.1, 2.0]])
    points = np.concatenate([ball, needle + np.array([3.0, 0.0, 0.0])])
    count = len(ball)
    triangles = np.concatenate([faces, [[count, count + 1, count + 2]]]).astype(np.int32)
    ranges = [BodyRange(0, count, 99.0), BodyRange(count, count + 3, 99.0)]
    surface = Surface(points, triangles, bodies=ranges)
    pose = np.concatenate([ball, needle]) / surface.size
    for queue in (None, DeviceQueue("cpu")):
        method = PaperMethod(surface, OPTIONS, queue=queue)
        assert method.descent is not None
        result = method.descent(torch.from_numpy(pose)[None])
        # The needle enters through a face and leaves by another one.
        assert result.history[0].tolist() == [3] and torch.isfinite(result.points).all()
        assert int(result.triangles) < 3


@pytest.mark.parametrize("bodies", [1, 2])
def test_the_loop_of_a_device_cleans_as_well(bodies: int) -> None:
    surface, poses = tube()
    if bodies == 2:
        points, faces = overlapping_spheres()
        half = len(points) // 2
        ranges = [BodyRange(0, half, 99.0), BodyRange(half, 2 * half, 999.0)]
        mobility = np.ones(len(points))
        mobility[:half] = 0.0
        surface = Surface(points, faces, bodies=ranges, mobility=mobility)
        poses = [points / surface.size]
    method = PaperMethod(surface, OPTIONS, queue=DeviceQueue("cpu"))
    assert isinstance(method.descent, DeviceDescent)
    for pose, solved in zip(poses, method.batch(poses), strict=True):
        assert 10 * len(surface.contacts.pairs(solved.points)) < len(surface.contacts.pairs(pose))
        if bodies == 2:
            assert np.array_equal(solved.points[:half], pose[:half])
            assert not np.array_equal(solved.points[half:], pose[half:])


@pytest.mark.parametrize("device", [False, True], ids=["cpu", "device"])
def test_the_laplacian_of_the_input_is_that_of_each_pose(device: bool) -> None:
    surface, poses = tube()
    queue = DeviceQueue("cpu") if device else None
    choices = replace(OPTIONS, laplacian="input", iterations=3)
    method = PaperMethod(surface, choices, queue=queue)
    for pose, solved in zip(poses, method.batch(poses), strict=True):
        # A surface whose rest is the pose has no other Laplacian.
        own = Surface(pose * surface.size, surface.faces)
        unit = surface.size / own.size
        expected = PaperMethod(own, replace(choices, laplacian="rest"))(pose * unit)
        other = PaperMethod(surface, replace(choices, laplacian="rest"))(pose)
        near = np.abs(solved.points * unit - expected.points).max()
        assert 10 * near < np.abs(solved.points - other.points).max(), near


def test_an_operator_that_does_not_fit_on_the_device_is_a_clear_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object, **__: object) -> None:
        raise RuntimeError("CUDA error: out of memory")

    surface, _ = tube()
    monkeypatch.setattr(Diffusion, "on", full)
    with pytest.raises(MemoryError, match=r"the diffusion operator of \d+ triangles .* 'cpu'"):
        PaperMethod(surface, OPTIONS, queue=DeviceQueue("cpu"))
