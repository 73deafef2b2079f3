"""Meshes that intersect themselves, for the tests of the detector."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests import meshes
from tests.soups import lattice_pairs, random_pairs, thinned

TWO_FACES = np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32)


def soup(pairs: NDArray[np.float32]) -> meshes.Mesh:
    """All triangles of pairs (K, 2, 3, 3) as one mesh without common vertices."""
    points = pairs.reshape(-1, 3).astype(np.float64)
    return points, np.arange(len(points), dtype=np.int32).reshape(-1, 3)


def crumpled(mesh: meshes.Mesh, amount: float, seed: int = 0) -> meshes.Mesh:
    points, faces = mesh
    return points + amount * np.random.default_rng(seed).normal(size=points.shape), faces


def collapsed(mesh: meshes.Mesh, share: float, seed: int = 0) -> meshes.Mesh:
    """A mesh of which a share of the vertices lies on other vertices, anywhere."""
    points, faces = mesh
    rng = np.random.default_rng(seed)
    place = np.where(rng.random(len(points)) < share, rng.permutation(len(points)), -1)
    return np.where(place[:, None] < 0, points, points[place]), faces


MESHES = {
    "random soup": soup(random_pairs(150, 1) * np.float32(0.6)),
    "lattice soup": soup(lattice_pairs(100, 2, 5)),
    "plane of overlapping triangles": soup(
        lattice_pairs(80, 3, 5) * np.array([1, 1, 0], dtype=np.float32)
    ),
    "random soup, a third thin": soup(thinned(random_pairs(100, 4) * np.float32(0.6), 0.3)),
    "lattice soup, a third thin": soup(thinned(lattice_pairs(100, 5, 6), 0.3)),
    "sphere squashed to a line": (meshes.icosphere(1)[0] * (1.0, 0.0, 0.0), meshes.icosphere(1)[1]),
    "sphere with corners on corners": collapsed(meshes.icosphere(2), 0.2),
    "crumpled grid": crumpled(meshes.grid(12, 12), 0.06),
    "crumpled sphere": crumpled(meshes.icosphere(2), 0.15),
    "bent tube": meshes.bent_tube(6.5, 10, 30),
    "crossing tubes": meshes.crossing_tubes(10, 14),
    "two equal grids in one plane": meshes.joined(meshes.grid(6, 6), meshes.grid(6, 6)),
    "grid on a shifted grid": meshes.joined(
        meshes.grid(5, 5), (meshes.grid(5, 5)[0] + (0.1, 0.05, 0), meshes.grid(5, 5)[1])
    ),
    "grid folded flat onto itself": (
        np.abs(meshes.grid(8, 8)[0] - (0.5, 0, 0)),
        meshes.grid(8, 8)[1],
    ),
    "crossing grids with points on the crossing": meshes.joined(
        meshes.grid(6, 6),
        (meshes.grid(6, 6)[0][:, [0, 2, 1]] + (0, 0.5, -0.5), meshes.grid(6, 6)[1]),
    ),
    "tori touching along circles": meshes.joined(
        meshes.torus(16, 8), (meshes.torus(16, 8)[0] + (0, 0, 0.6), meshes.torus(16, 8)[1])
    ),
    "tiny crumpled sphere": (
        1e-40 * crumpled(meshes.icosphere(2), 0.15)[0],
        meshes.icosphere(2)[1],
    ),
    "huge crumpled sphere": (1e38 * crumpled(meshes.icosphere(2), 0.15)[0], meshes.icosphere(2)[1]),
    "far crumpled sphere": (1e6 + crumpled(meshes.icosphere(2), 0.15)[0], meshes.icosphere(2)[1]),
}
