"""Scenes whose repair on a device is compared with the CPU's: doubts, bodies, pins, directions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from benchmarks.detection import Faces, Points
from dtrepair.device import DeviceQueue
from dtrepair.intersect.detector import Detector
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.paper.descent import Descent, DescentResult
from dtrepair.repair.paper.gpu_detection import FixedDetection
from dtrepair.repair.paper.method import PaperMethod
from dtrepair.repair.surface.surface import BodyRange, Surface

ITERATIONS = 10
# What points may differ by, in units of the mesh's size, and a change no result should depend on.
AGREEMENT, LAST_DIGITS = 1e-5, 1e-13
SIDE, UP = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class DeviceScene:
    """A surface, and poses (B, V, 3) in units of its size."""

    name: str
    surface: Surface
    poses: Points


def rod(around: int, along: int) -> tuple[Points, Faces]:
    """A closed rod along x: its caps are fans of triangles in one plane, which leaves doubts."""
    angle = 2 * np.pi * np.arange(around) / around
    x = np.linspace(0.0, 4.0, along + 1)
    ring = np.stack([0 * angle, 0.5 * np.cos(angle), 0.5 * np.sin(angle)], axis=1)
    points = (ring[None] + x[:, None, None] * [1.0, 0.0, 0.0]).reshape(-1, 3)
    start, k = np.meshgrid(np.arange(along) * around, np.arange(around), indexing="ij")
    a, b = start + k, start + (k + 1) % around
    sides = [np.stack([a, b, b + around], axis=2), np.stack([a, b + around, a + around], axis=2)]
    fan = np.stack([0 * k[0, 2:], k[0, 2:], k[0, 2:] - 1], axis=1)
    caps = [fan, fan[:, ::-1] + along * around]
    faces = np.concatenate([*(side.reshape(-1, 3) for side in sides), *caps])
    return points, faces.astype(np.int32)


def device_scenes(around: int = 12, along: int = 16, poses: int = 3) -> Iterator[DeviceScene]:
    """Two rods that cross ever deeper: free, one of them pinned, and led to one side."""
    points, faces = rod(around, along)
    count = len(points)
    # Askew: where corners touch faces, rounding decides what becomes of a repair.
    turn = Rotation.from_rotvec([0.1, -0.07, 0.4])
    other = turn.apply(points[:, [1, 0, 2]] - 2.0 * SIDE) + np.array([2.03, 0.05, 0.0])
    both = np.concatenate([faces, faces + count]).astype(np.int32)
    # A needle ends in the second rod: a triangle without area.
    needle = np.array([[2.0, 0.1, 1.5], [2.0, 0.1, 1.8], [2.0, 0.1, 2.1]])
    both = np.concatenate([both, [[2 * count, 2 * count + 1, 2 * count + 2]]]).astype(np.int32)
    rest = np.concatenate([points, other + 1.2 * UP, needle + UP])
    depths = np.linspace(0.05, 0.25, poses)
    moved = [
        np.concatenate([points, other + (1.0 - depth) * UP, needle - (0.1 + depth) * UP])
        for depth in depths
    ]
    ranges = [BodyRange(0, count, 99.0), BodyRange(count, len(rest), 999.0)]
    pinned = np.ones(len(rest))
    pinned[:count] = 0.0
    half = np.ones(len(rest))
    half[: count // 2] = 0.0
    upwards = np.zeros((len(rest), 3))
    upwards[count:, 2] = 1.0
    for name, mobility, direction in (
        ("two bodies", None, None),
        ("one pinned", pinned, None),
        ("half pinned, a direction", half, upwards),
    ):
        surface = Surface(rest, both, bodies=ranges, mobility=mobility, direction=direction)
        yield DeviceScene(name, surface, np.stack(moved) / surface.size)


def scene_checks(queue: DeviceQueue) -> Iterator[tuple[str, bool, str]]:
    """What was checked, whether it holds, and the figure."""
    for scene in device_scenes():
        yield _same_pairs(scene, queue)
        yield _same_repairs(scene, queue)


def _same_pairs(scene: DeviceScene, queue: DeviceQueue) -> tuple[str, bool, str]:
    """Pairs of the loops on both devices, and of exact counts of what may move."""
    surface = scene.surface
    detector = Detector(surface.written(surface.rest), surface.faces, device=queue.device)
    poses = surface.written(scene.poses)
    found = FixedDetection(
        detector, len(poses), queue, counted=surface.contacts.counted_pairs, capacity=(1 << 16,) * 2
    )
    with queue.active():
        found.points.copy_(torch.from_numpy(poses))
        found.run()
        rows = found.pairs[: int(found.count)].cpu().numpy()
        triangles = found.triangles.cpu().numpy()
    rows = rows[np.lexsort(rows.T[::-1])]
    exact = surface.detector(poses)
    exact = exact[surface.contacts.counts(exact)]
    counts = [len(np.unique(exact[exact[:, 0] == k, 1:])) for k in range(len(poses))]
    in_doubt = len(surface.detector(poses, exact=False)) - len(surface.detector(poses))
    holds = np.array_equal(rows, exact) and triangles.tolist() == counts and in_doubt > 0
    holds &= np.array_equal(rows, surface.contacts.batch_pairs(scene.poses))
    told = ", ".join(map(str, counts))
    return f"exact counts, {scene.name}", bool(holds), f"{told} triangles; {in_doubt} in doubt"


def _same_repairs(scene: DeviceScene, queue: DeviceQueue) -> tuple[str, bool, str]:
    """Histories and points of whole repairs, of poses that do not hang on the last digits."""
    options = RepairOptions(method="paper", iterations=ITERATIONS)
    poses = torch.from_numpy(scene.poses)
    loop: Callable[[torch.Tensor], DescentResult] | None
    loop = PaperMethod(scene.surface, options).descent
    assert isinstance(loop, Descent)
    expected = loop(poses)
    noise = torch.randn(poses.shape, generator=torch.Generator().manual_seed(0), dtype=poses.dtype)
    shaken = loop(poses + LAST_DIGITS * noise)
    there = PaperMethod(scene.surface, options, queue=queue).descent
    assert there is not None
    received = there(poses)
    stable = (shaken.points - expected.points).abs().amax(dim=(1, 2)) < AGREEMENT
    same = (expected.triangles == received.triangles) & (expected.iterations == received.iterations)
    moved = (expected.points - received.points).abs().amax(dim=(1, 2))
    begun = torch.equal(expected.history[0], received.history[0])
    fixed = torch.from_numpy(scene.surface.fixed)
    still = torch.equal(received.points[:, fixed], poses[:, fixed])
    holds = begun and still and bool(stable.any())
    holds = holds and bool(same[stable].all()) and float(moved[stable].amax()) < AGREEMENT
    columns = (expected.history[0], received.triangles, received.iterations, stable)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    told = ", ".join(f"{a}→{b} in {n}{'' if ok else ' (unstable)'}" for a, b, n, ok in rows)
    return f"repairs, {scene.name}", holds, told
