"""The detector's definition of a pair, its limits, its reuse."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect import detector as detector_module
from dtrepair.intersect.detector import Detector, find_intersections, triangle_count
from dtrepair.intersect.ignored import CollapsedPoseError, PairLimits
from dtrepair.intersect.proximity import close_pairs
from dtrepair.intersect.tree import build_tree
from dtrepair.numerics.geometry import weld_map
from tests import meshes
from tests.cgal_reference import cgal_pairs
from tests.crossing_meshes import MESHES, TWO_FACES, crumpled, soup
from tests.soups import random_pairs


def test_rows_are_sorted_and_smaller_indices_come_first() -> None:
    points, faces = MESHES["random soup"]
    pairs = Detector(points, faces)(points)
    assert pairs.dtype == np.int32 and pairs.flags.c_contiguous
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert pairs.tolist() == sorted(pairs.tolist())


def test_a_batch_equals_its_frames() -> None:
    points, faces = meshes.crossing_tubes(10, 14)
    detector = Detector(points, faces)
    upper = np.arange(len(points)) >= len(points) // 2
    poses = np.stack([points + np.outer(upper, (0, lift, 0)) for lift in np.linspace(0, 0.5, 7)])
    batch = detector(poses)
    assert batch.shape[1] == 3 and batch.tolist() == sorted(batch.tolist())
    for frame, pose in enumerate(poses):
        assert np.array_equal(batch[batch[:, 0] == frame, 1:], detector(pose))
    counts = np.bincount(batch[:, 0], minlength=7)
    assert counts[0] > 0 and counts[-1] == 0, "the tubes should come apart"


def test_a_batch_of_no_frames_is_empty() -> None:
    points, faces = meshes.icosphere(1)
    assert Detector(points, faces)(np.zeros((0, len(points), 3))).shape == (0, 3)


def test_touching_counts_and_the_next_float_does_not() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, 0], [0.2, 0.2, 1], [1, 1, 1.0]])
    detector = Detector(points, TWO_FACES)
    assert detector(points).tolist() == [[0, 1]]
    points[3, 2] = np.nextafter(np.float32(0), np.float32(1))
    assert detector(points).tolist() == []


def test_coordinates_are_rounded_to_float32() -> None:
    points = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [0.2, 0.2, 1], [0.2, 0.2, 2], [1, 1, 2.0]])
    points[3, 2] = 1 + 1e-9
    assert Detector(points, TWO_FACES)(points).tolist() == [[0, 1]]


def test_pairs_that_share_a_vertex_do_not_count() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0.9, 0], [0.9, 1, 0]])
    # Both lie in one plane and overlap beyond the vertex they share.
    faces = np.array([[0, 1, 2], [0, 3, 4]], dtype=np.int32)
    assert Detector(points, faces)(points).tolist() == []


def test_a_vertex_of_very_many_triangles_makes_no_pairs() -> None:
    count = 5000
    angles = 2 * np.pi * np.arange(count) / count
    rim = np.stack([np.cos(angles), np.sin(angles), 0.3 * np.cos(3 * angles)], axis=1)
    points = np.vstack([[0, 0, 1], rim, [0.3, 0.2, -1], [0.31, 0.2, 2], [0.3, 0.21, 2]])
    k = np.arange(count)
    fan = np.stack([np.zeros(count, int), 1 + k, 1 + (k + 1) % count], axis=1)
    spike = [[count + 1, count + 2, count + 3]]
    cone = Detector(points, fan)(points)
    assert cone.shape == (0, 2)
    pairs = Detector(points, np.concatenate([fan, spike]))(points)
    assert len(pairs) > 0 and (pairs[:, 1] == count).all()


def test_seams_weld() -> None:
    points, faces = meshes.tube(12, 6)
    # The same surface with its first column of vertices doubled, as a texture seam does.
    seam = np.arange(0, len(points), 12)
    double = np.concatenate([points, points[seam]])
    copies = {int(v): len(points) + k for k, v in enumerate(seam)}
    split = faces.copy()
    right = points[faces][:, :, 1].mean(axis=1) > 0
    at_seam = np.isin(faces, seam) & right[:, None]
    split[at_seam] = [copies[int(v)] for v in faces[at_seam]]
    unwelded = Detector(double, split)(double)
    assert len(unwelded) > 0, "both sides of the seam should touch"
    assert Detector(double, split, weld=weld_map(double))(double).tolist() == []
    assert Detector(double, split)(double, weld=weld_map(double)).tolist() == []
    assert find_intersections(double, split).tolist() == []
    assert np.array_equal(unwelded, cgal_pairs(double, split))


def test_a_triangle_without_area_is_the_segment_or_the_point_of_its_corners() -> None:
    needle = [[0.2, 0.2, -1], [0.2, 0.2, 1], [0.2, 0.2, 3.0]]
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], *needle])
    assert find_intersections(points, TWO_FACES).tolist() == [[0, 1]]
    points[5] = 0.2, 0.2, 1  # two of its corners are one
    assert find_intersections(points, TWO_FACES).tolist() == [[0, 1]]
    points[3:] = 0.2, 0.2, 0  # all three
    assert find_intersections(points, TWO_FACES).tolist() == [[0, 1]]
    points[3:, 2] = 1e-30
    assert find_intersections(points, TWO_FACES).tolist() == []
    points[:3] = [[0.2, -1, 0.5], [0.2, 0.5, 0.5], [0.2, 2, 0.5]]
    points[3:] = needle
    assert find_intersections(points, TWO_FACES).tolist() == [[0, 1]]
    points[:3, 0] += 1e-6
    assert find_intersections(points, TWO_FACES).tolist() == []


def test_a_pose_with_too_many_pairs_is_refused_before_they_are_kept() -> None:
    points, faces = meshes.icosphere(1)
    everything = len(faces) * (len(faces) - 1) // 2
    point = np.zeros_like(points)
    few = PairLimits(candidates=4, pairs=1, least_candidates=500, least_pairs=60)
    detector = Detector(points, faces, limits=few)
    pinched = points * np.where(np.arange(len(points)) == 3, -1.5, 1.0)[:, None]
    assert 0 < len(detector(pinched)) <= 60
    for pose in (point, np.stack([points, point])):
        with pytest.raises(CollapsedPoseError, match="80 triangles lie at one place"):
            detector(pose)
        with pytest.raises(CollapsedPoseError, match="collapsed"):
            close_pairs(detector, point.astype(np.float32), 0.1)
    assert len(detector(points)) == 0  # nothing is left over
    # Few boxes overlap, and all of them intersect.
    roomy = PairLimits(candidates=99, pairs=1, least_candidates=0, least_pairs=0)
    with pytest.raises(CollapsedPoseError):
        Detector(points, faces, limits=roomy)(point)
    enough = PairLimits(candidates=99, pairs=99, least_candidates=0, least_pairs=0)
    assert 0 < len(Detector(points, faces, limits=enough)(point)) < everything
    # As one vertex they all are neighbours: that is no pair, but not looked through without end.
    weld = np.zeros(len(points), dtype=np.int32)
    assert len(detector(point, weld=weld)) == 0
    brief = PairLimits(of_leaf=300)
    with pytest.raises(CollapsedPoseError):
        Detector(points, faces, limits=brief)(point, weld=weld)


def test_a_pose_with_more_pairs_than_32_bits_count_is_refused() -> None:
    # 70,000 triangles at one place have 2.4e9 pairs.
    points = np.random.default_rng(0).random((35_000, 3))
    faces = np.random.default_rng(1).integers(0, 35_000, (70_000, 3))
    with pytest.raises(CollapsedPoseError, match="70,000 triangles"):
        Detector(points, faces)(np.zeros_like(points))


def test_thin_triangles_along_a_seam_do_not_meet_their_neighbours() -> None:
    """The upper side of a seam has a vertex more on each edge; a thin triangle closes each gap."""
    cells = 7
    seam = np.arange(cells + 1)
    middle, below, above = seam + cells + 1, seam + 2 * cells + 2, seam + 3 * cells + 3
    a, b = seam[:-1], seam[1:]
    faces = np.concatenate(
        [
            np.stack(corners, axis=1)
            for corners in (
                (below[:-1], below[1:], b),
                (below[:-1], b, a),
                (a, middle[:-1], above[:-1]),
                (middle[:-1], b, above[:-1]),
                (b, above[1:], above[:-1]),
                (a, b, middle[:-1]),
            )
        ]
    )
    x = 0.1 * np.tile(seam, 4) + np.repeat([0.0, 0.05, 0.0, 0.05], cells + 1)
    y = np.repeat([0.0, 0.0, -0.1, 0.1], cells + 1)
    points = np.stack([x, y, np.zeros_like(x)], axis=1)
    turned = np.stack([y, np.zeros_like(x), x + 3.0], axis=1)
    for pose in (points, turned):
        assert find_intersections(pose, faces).tolist() == []
        pose[middle[3]] = pose[b[3]] + 1.4 * (pose[b[3]] - pose[a[3]])  # beyond its neighbours
        assert len(find_intersections(pose, faces)) > 0


def test_a_full_buffer_grows() -> None:
    # Crossing fans of n and m triangles: n * m pairs, far more than the first buffer holds.
    count = 150
    points, faces = soup(random_pairs(count, 0))
    points[:] = 0.0
    corners = points.reshape(2, count, 3, 3)
    heights = np.linspace(0, 1, count)
    corners[0] = [[-2, -2, 0], [4, -2, 0], [-2, 4, 0]]
    corners[0, :, :, 2] = heights[:, None]
    corners[1] = [[0, 0, -1], [0, 0, 2], [1, 1, 2]]
    corners[1, :, :, 0] += heights[:, None]
    detector = Detector(points, faces)
    assert detector._capacity < count * count
    pairs = detector(points)
    expected = [[i, count + j] for i in range(count) for j in range(count)]
    across = pairs[(pairs[:, 0] < count) & (pairs[:, 1] >= count)]
    assert across.tolist() == expected
    assert np.array_equal(pairs, detector(points))


def test_results_repeat_and_leave_the_input_alone() -> None:
    points, faces = MESHES["random soup"]
    kept = points.copy()
    detector = Detector(points, faces)
    first = detector(points)
    assert all(np.array_equal(first, detector(points)) for _ in range(3))
    assert np.array_equal(first, Detector(points, faces)(points))
    assert np.array_equal(points, kept)


def test_threads_may_share_a_detector() -> None:
    points, faces = MESHES["crumpled sphere"]
    detector = Detector(points, faces)
    poses = [crumpled(meshes.icosphere(2), 0.15, seed)[0] for seed in range(16)]
    expected = [detector(pose) for pose in poses]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(detector, poses))
    assert all(np.array_equal(a, b) for a, b in zip(found, expected, strict=True))


def test_a_buffer_that_another_thread_enlarges_is_not_overrun() -> None:
    class Disturbed(Detector):
        def search(self, *arguments: Any, **options: Any) -> None:
            super().search(*arguments, **options)
            self._capacity = 1 << 20

    points, faces = MESHES["random soup"]
    detector = Disturbed(points, faces)
    detector._capacity = 1
    assert np.array_equal(detector(points), Detector(points, faces)(points))


def test_the_rest_pose_decides_nothing_but_speed() -> None:
    points, faces = MESHES["bent tube"]
    straight = meshes.bent_tube(0.0, 10, 30)[0]
    scrambled = np.random.default_rng(0).permutation(points)
    expected = Detector(points, faces)(points)
    for rest in (straight, scrambled, np.zeros_like(points)):
        assert np.array_equal(Detector(rest, faces)(points), expected)


def test_the_order_of_faces_only_renames_pairs() -> None:
    points, faces = MESHES["crumpled grid"]
    order = np.random.default_rng(0).permutation(len(faces))
    renamed = np.sort(order[Detector(points, faces[order])(points)], axis=1)
    renamed = renamed[np.lexsort((renamed[:, 1], renamed[:, 0]))]
    assert np.array_equal(renamed, Detector(points, faces)(points))


def test_one_tree_serves_all_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    built: list[int] = []
    build = build_tree

    def counting(centroids: NDArray[np.float64]) -> object:
        built.append(len(centroids))
        return build(centroids)

    monkeypatch.setattr(detector_module, "build_tree", counting)
    points, faces = MESHES["crumpled sphere"]
    detector = Detector(points, faces)
    for scale in (1.0, 2.0, 3.0):
        detector(points * scale)
    assert built == [len(faces)]
    Detector(*MESHES["bent tube"])
    assert len(built) == 2


def test_active_triangles_narrow_the_search() -> None:
    points, faces = MESHES["random soup"]
    detector = Detector(points, faces)
    pairs = detector(points)
    active = np.random.default_rng(0).random(len(faces)) < 0.3
    expected = pairs[active[pairs].any(axis=1)]
    assert np.array_equal(detector(points, active=active), expected)
    assert len(detector(points, active=np.zeros(len(faces), dtype=bool))) == 0
    assert np.array_equal(detector(points, active=np.ones(len(faces), dtype=bool)), pairs)


def test_triangle_count_counts_each_triangle_once() -> None:
    assert triangle_count(np.array([[0, 1], [0, 2], [1, 2]], dtype=np.int32)) == 3
    assert triangle_count(np.zeros((0, 2), dtype=np.int32)) == 0
