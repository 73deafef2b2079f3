"""The detector finds exactly the pairs of CGAL, of brute force and of an independent checker."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector, find_intersections, triangle_count
from tests import meshes
from tests.cgal_reference import cgal_intersect, cgal_pairs
from tests.crossing_meshes import MESHES, TWO_FACES
from tests.integer_arithmetic import integer_intersect
from tests.soups import stress_families

CERTAIN, UNCERTAIN = 1, 2


def brute_force(points: NDArray[Any], faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Every pair without a common vertex through the exact test."""
    i, j = np.triu_indices(len(faces), 1)
    free = ~(faces[i][:, :, None] == faces[j][:, None, :]).any(axis=(1, 2))
    i, j = i[free], j[free]
    corners = points.astype(np.float32)[faces]
    hit = integer_intersect(corners[i], corners[j])
    return np.stack([i[hit], j[hit]], axis=1).astype(np.int32)


def read_obj(path: Path) -> meshes.Mesh:
    """Points and fan-triangulated faces of a Wavefront file."""
    rows = [line.split() for line in path.read_text().splitlines()]
    points = [[float(x) for x in row[1:4]] for row in rows if row[:1] == ["v"]]
    polygons = [[int(x.split("/")[0]) - 1 for x in row[1:]] for row in rows if row[:1] == ["f"]]
    fans = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    return np.array(points), np.array(fans, dtype=np.int32)


@pytest.mark.parametrize("name", MESHES)
def test_pairs_equal_those_of_cgal(name: str) -> None:
    points, faces = MESHES[name]
    expected = cgal_pairs(points, faces)
    assert len(expected) > 0, "the mesh should intersect itself"
    assert np.array_equal(Detector(points, faces)(points), expected)


@pytest.mark.parametrize("name", ["lattice soup", "crumpled sphere", "grid on a shifted grid"])
def test_pairs_equal_brute_force(name: str) -> None:
    points, faces = MESHES[name]
    assert np.array_equal(Detector(points, faces)(points), brute_force(points, faces))


@pytest.mark.parametrize("family", stress_families(1))
def test_stress_pairs_have_the_verdict_of_cgal(family: str) -> None:
    pairs = stress_families(2000)[family]
    expected = cgal_intersect(pairs[:, 0], pairs[:, 1])
    poses = pairs.reshape(-1, 6, 3)
    detector = Detector(poses[0], TWO_FACES)
    found = detector(poses)
    assert np.array_equal(found[:, 0], np.flatnonzero(expected))
    verdict = np.zeros(len(pairs), dtype=int)
    rows = detector.candidates(poses)
    verdict[rows[:, 0]] = rows[:, 3]
    assert expected[verdict == CERTAIN].all(), "a certain pair should intersect"
    assert not expected[verdict == 0].any(), "a pair left out should be apart"


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("name", MESHES)
def test_cuda_finds_the_pairs_of_the_cpu(name: str) -> None:
    points, faces = MESHES[name]
    expected = Detector(points, faces)(points)
    detector = Detector(points, faces, device="cuda:0")
    assert np.array_equal(detector(points), expected)
    assert np.array_equal(detector(torch.tensor(points, device="cuda:0")), expected)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize("family", stress_families(1))
def test_cuda_settles_stress_pairs_as_the_cpu(family: str) -> None:
    poses = stress_families(2000)[family].reshape(-1, 6, 3)
    expected = Detector(poses[0], TWO_FACES)(poses)
    assert np.array_equal(Detector(poses[0], TWO_FACES, device="cuda:0")(poses), expected)


def test_few_generic_pairs_are_uncertain() -> None:
    points, faces = MESHES["crumpled sphere"]
    rows = Detector(points, faces).candidates(points.astype(np.float32)[None])
    assert (rows[:, 3] == UNCERTAIN).mean() < 0.02


def test_without_exact_arithmetic_no_pair_is_missed() -> None:
    points, faces = MESHES["lattice soup"]
    detector = Detector(points, faces)
    exact = {tuple(pair) for pair in detector(points).tolist()}
    rough = {tuple(pair) for pair in detector(points, exact=False).tolist()}
    assert exact < rough


@pytest.mark.parametrize(
    "mesh", [meshes.icosphere(2), meshes.torus(), meshes.bent_tube(5.5), meshes.grid(9, 7)]
)
def test_clean_meshes_have_no_pairs(mesh: meshes.Mesh) -> None:
    assert find_intersections(*mesh).shape == (0, 2)


def test_the_largest_numbers_stay_in_bounds() -> None:
    # Boxes that reach from end to end of float32 meet the unused places of other leaves, too.
    top = float(np.finfo(np.float32).max)
    rng = np.random.default_rng(0)
    points = top * rng.choice([-1.0, 1.0, 0.5, -0.25], (60, 3))
    faces = np.arange(60, dtype=np.int32).reshape(-1, 3)
    assert np.array_equal(Detector(points, faces)(points), cgal_pairs(points, faces))


def test_counts_of_real_meshes_equal_the_independent_checker(shared_data: Path) -> None:
    baseline = json.loads((shared_data / "baseline.json").read_text())
    for entry in baseline["static"]:
        pairs = find_intersections(*read_obj(shared_data / entry["file"]))
        expected = entry["r"]["si_tris"], entry["r"]["si_pairs"]
        assert (triangle_count(pairs), len(pairs)) == expected, entry["file"]


def test_counts_of_a_real_clip_equal_the_independent_checker(shared_data: Path) -> None:
    usd = pytest.importorskip("pxr.Usd")
    geometry = pytest.importorskip("pxr.UsdGeom")
    baseline = json.loads((shared_data / "baseline.json").read_text())
    clip = next(clip for clip in baseline["clips"] if clip["file"] == "humans/walk_male.usdc")
    stage = usd.Stage.Open(str(shared_data / clip["file"]))
    mesh = geometry.Mesh(next(p for p in stage.Traverse() if p.IsA(geometry.Mesh)))
    quads = np.array(mesh.GetFaceVertexIndicesAttr().Get(), dtype=np.int32).reshape(-1, 4)
    times = [row["time"] for row in clip["rows"]]
    poses = np.stack([np.array(mesh.GetPointsAttr().Get(time)) for time in times])
    detector = Detector(poses[0], meshes.split_quads(quads))
    pairs = detector(poses)
    for frame, row in enumerate(clip["rows"]):
        own = pairs[pairs[:, 0] == frame, 1:]
        assert (triangle_count(own), len(own)) == (row["si_tris"], row["si_pairs"]), row["time"]
