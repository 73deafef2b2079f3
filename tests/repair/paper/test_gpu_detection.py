"""Detection into fixed buffers: the pairs of the detector, and a word where there is no room."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dtrepair.device import DeviceQueue
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.ignored import CollapsedPoseError, CountedPairs
from dtrepair.repair.paper.gpu_detection import FixedDetection
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import bent_tube, icosphere, joined, overlapping_spheres
from tests.repair.surface.test_uncertain_pairs import capped_cylinder

QUEUE = DeviceQueue("cpu")


def found(detection: FixedDetection, poses: NDArray[np.floating]) -> NDArray[np.int32]:
    """Sorted rows (K, 3) for poses (B, V, 3)."""
    detection.points.copy_(torch.from_numpy(poses))
    detection.run()
    rows = detection.pairs[: int(detection.count)].numpy()
    return rows[np.lexsort(rows.T[::-1])]


def overflow(detection: FixedDetection) -> tuple[int, int] | None:
    """A capacity that would have done, if that of the detection did not."""
    return detection.larger_than(detection.needed.tolist())


def tubes() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Poses (3, V, 3) of a tube bent ever more, and its triangles."""
    meshes = [bent_tube(angle, around=12, along=40, radius=0.08) for angle in (3.0, 6.4, 6.8)]
    return np.stack([points for points, _ in meshes]), meshes[0][1]


def test_pairs_are_those_of_the_detector_for_every_pose_of_a_batch() -> None:
    poses, faces = tubes()
    detector = Detector(poses[0], faces)
    expected = detector(poses)
    detection = FixedDetection(detector, 3, QUEUE)
    assert len(expected) > 50 and len(set(expected[:, 0])) == 2
    for batch in (poses, poses[::-1].copy(), poses):  # nothing is left over from a run before
        expected = detector(batch)
        assert np.array_equal(found(detection, batch), expected)
        counts = [len(np.unique(expected[expected[:, 0] == k, 1:])) for k in range(3)]
        assert detection.triangles.tolist() == counts
    assert overflow(detection) is None


@pytest.mark.parametrize(
    "capacity, roomy", [((10, 1000), False), ((4000, 10), False), ((4000, 1000), True)]
)
def test_too_little_room_is_told_with_what_would_do(capacity: tuple[int, int], roomy: bool) -> None:
    poses, faces = tubes()
    detector = Detector(poses[0], faces)
    detection = FixedDetection(detector, 3, QUEUE, capacity=capacity)
    rows = found(detection, poses)
    if roomy:
        assert overflow(detection) is None
        return
    wanted = overflow(detection)
    assert wanted is not None and len(rows) < 1000
    # Pairs beyond the buffer of candidates are not known: it may take two rounds.
    while (more := overflow(detection)) is not None:
        detection = FixedDetection(detector, 3, QUEUE, capacity=more)
        rows = found(detection, poses)
    assert np.array_equal(rows, detector(poses))


def test_what_counts_is_what_counts_for_the_surface() -> None:
    points, faces = joined(*[overlapping_spheres()] * 2)
    points[len(points) // 2 :] += [0.7, 0.1, 0.0]
    quarter = len(points) // 4
    ranges = [BodyRange(k * quarter, (k + 1) * quarter, 99.0, rigid=k == 3) for k in range(4)]
    mobility = np.ones(len(points))
    mobility[: 2 * quarter] = 0.0
    poses = points[None] + np.random.default_rng(0).normal(size=(2, 1, 3)) * 0.01
    poses[1, [10, 40]] *= -1.1  # the first ball, about the origin, crosses itself
    results = []
    for options in (
        {},
        {"mode": "inter"},
        {"mode": "self"},
        {"ignored": [(1, 2), (2, 3)]},
        {"mobility": mobility},
        {"leave_rest": True},
    ):
        surface = Surface(points, faces, bodies=ranges, **options)
        detection = FixedDetection(
            surface.detector, 2, QUEUE, counted=surface.contacts.counted_pairs
        )
        rows = found(detection, surface.written(poses / surface.size))
        assert np.array_equal(rows, surface.contacts.batch_pairs(poses / surface.size))
        results.append(len(rows))
    assert len(set(results)) == len(results) and min(results) > 0


def test_what_is_in_doubt_and_clear_at_rest_is_settled() -> None:
    points, faces = joined(capped_cylinder(), capped_cylinder())
    half = len(points) // 2
    points[half:] += [0.0, 0.0, 3.0]
    # Besides, a triangle without area: it stands beside the second cylinder, or leans on it.
    points = np.concatenate([points, [[5.0, 0, 3], [5.0, 0, 4], [5.0, 0, 5]]])
    faces = np.concatenate([faces, [[2 * half, 2 * half + 1, 2 * half + 2]]]).astype(np.int32)
    poses = np.stack([points, points, points])
    poses[1, half : 2 * half] -= [0.5, 0.0, 2.0]  # into the first
    poses[2, 2 * half :] = [[0.2, -1, 2], [0.9, 0.1, 3.1], [1.6, 1.2, 4.2]]
    poses[1, 2 * half :] = poses[2, 2 * half :]
    surface = Surface(points, faces)
    units = poses / surface.size
    detection = FixedDetection(surface.detector, 3, QUEUE, counted=surface.contacts.counted_pairs)
    rows = found(detection, surface.written(units))
    assert np.array_equal(rows, surface.contacts.batch_pairs(units))
    assert len(rows[rows[:, 0] == 0]) == 0 < len(rows[rows[:, 0] == 2]) < len(rows)
    rough = surface.detector(surface.written(units), exact=False)
    assert len(rough[rough[:, 0] == 0]) > 0 and len(rough) > len(rows)
    # Room for pairs is also room for doubts, and told as such.
    small = FixedDetection(
        surface.detector, 3, QUEUE, counted=surface.contacts.counted_pairs, capacity=(10**5, 8)
    )
    found(small, surface.written(units))
    wanted = overflow(small)
    assert wanted is not None
    enough = FixedDetection(
        surface.detector, 3, QUEUE, counted=surface.contacts.counted_pairs, capacity=wanted
    )
    assert np.array_equal(found(enough, surface.written(units)), rows)


def test_a_pair_can_be_left_out_by_number_and_a_mesh_may_have_no_triangles() -> None:
    poses, faces = tubes()
    detector = Detector(poses[0], faces)
    pairs = detector(poses[1])
    group, counted = np.zeros(len(faces), dtype=np.int32), np.ones((1, 1), dtype=bool)
    detection = FixedDetection(detector, 1, QUEUE, counted=CountedPairs(group, counted, pairs[::2]))
    assert np.array_equal(found(detection, poses[1:2])[:, 1:], pairs[1::2])
    empty = FixedDetection(Detector(icosphere(0)[0], np.zeros((0, 3), dtype=np.int32)), 2, QUEUE)
    empty.run()
    assert int(empty.count) == 0 and empty.triangles.tolist() == [0, 0]


def test_a_collapsed_pose_is_told_and_never_makes_others_clean() -> None:
    # The pairs of the pose that is a point are more than 32 bits count: they wrapped to less than
    # nothing, for which there was room, and the other pose passed for clean.
    ball, ball_faces = icosphere(0)
    points = np.concatenate([ball, ball + np.array([0.1, 0.2, 0.3])])
    count = 70_000
    faces = np.tile(np.concatenate([ball_faces, ball_faces + len(ball)]), (count // 40, 1))
    detector = Detector(points, faces, weld=np.where(np.arange(len(points)) < len(ball), 0, 12))
    detection = FixedDetection(detector, 2, QUEUE)
    detection.points.copy_(torch.from_numpy(np.stack([points, np.zeros_like(points)])))
    detection.run()
    assert int(detection.needed.min()) >= 0
    with pytest.raises(CollapsedPoseError, match=f"{count:,} triangles"):
        overflow(detection)


def test_poses_of_nan_have_no_pairs_and_cost_nothing() -> None:
    poses, faces = tubes()
    detector = Detector(poses[0], faces)
    alone = FixedDetection(detector, 1, QUEUE)
    rows = found(alone, poses[1:2])
    both = FixedDetection(detector, 2, QUEUE)
    with_nan = found(both, np.stack([np.full_like(poses[0], np.nan), poses[1]]))
    assert np.array_equal(with_nan[:, 1:], rows[:, 1:]) and (with_nan[:, 0] == 1).all()
    # Not even boxes overlap.
    assert both.needed.tolist() == alone.needed.tolist() and alone.needed[0] > 0
