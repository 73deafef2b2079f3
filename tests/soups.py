"""Pairs of triangles (K, 2, 3, 3) float32 that try the exactness of intersection tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Pairs = NDArray[np.float32]


def random_pairs(count: int, seed: int = 0) -> Pairs:
    """Two independent triangles in the unit cube: about one pair in five intersects."""
    return np.random.default_rng(seed).random((count, 2, 3, 3)).astype(np.float32)


def lattice_pairs(count: int, seed: int = 0, size: int = 3) -> Pairs:
    """Corners on a small integer lattice: coplanar, touching, collinear and equal parts abound."""
    return np.random.default_rng(seed).integers(0, size, (count, 2, 3, 3)).astype(np.float32)


def flat_pairs(count: int, seed: int = 0) -> Pairs:
    """Both triangles in one axis-aligned plane, corners on a lattice: exactly coplanar."""
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, 6, (count, 2, 3, 3)).astype(np.float32)
    pairs[np.arange(count), :, :, rng.integers(0, 3, count)] = 0.1
    return pairs


def tilted_pairs(count: int, seed: int = 0) -> Pairs:
    """Both triangles in one tilted plane, exactly: corners on a lattice that float32 holds."""
    rng = np.random.default_rng(seed)
    steps = rng.integers(-(2**20), 2**20, (count, 2, 3))
    pairs = np.einsum("kpcx,kxd->kpcd", rng.integers(0, 6, (count, 2, 3, 2)), steps)
    points: Pairs = pairs.astype(np.float32)
    return points


def nearly_flat_pairs(count: int, seed: int = 0) -> Pairs:
    """Both triangles in one tilted plane, rounded to float32: coplanar but for the rounding."""
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    inside = rng.random((count, 2, 3, 2))
    points: Pairs = np.einsum("kpcx,kxd->kpcd", inside, frame[:, :2]).astype(np.float32)
    return points


def vertex_contacts(count: int, seed: int = 0) -> Pairs:
    """A corner of the second triangle on the first one, rounded to float32."""
    rng = np.random.default_rng(seed)
    first, second = rng.random((count, 3, 3)).astype(np.float32), rng.random((count, 3, 3))
    weights = rng.dirichlet([1, 1, 1], count)
    second[:, 0] = np.einsum("kc,kcd->kd", weights, first)
    return np.stack([first, second.astype(np.float32)], axis=1)


def edge_contacts(count: int, seed: int = 0) -> Pairs:
    """An edge of each through one point, rounded to float32."""
    rng = np.random.default_rng(seed)
    pairs = rng.random((count, 2, 3, 3))
    middle = rng.random((count, 1, 3))
    step = rng.normal(size=(count, 2, 3))
    pairs[:, :, 0] = middle + step * rng.random((count, 2, 1))
    pairs[:, :, 1] = middle - step * rng.random((count, 2, 1))
    return pairs.astype(np.float32)


def shared_positions(count: int, seed: int = 0) -> Pairs:
    """One or two corners of both triangles at the same place, some moved by one float32 ulp."""
    rng = np.random.default_rng(seed)
    pairs = random_pairs(count, seed)
    pairs[:, 1, 0] = pairs[:, 0, 0]
    two = rng.random(count) < 0.5
    pairs[two, 1, 1] = pairs[two, 0, 1]
    moved = rng.random(count) < 0.5
    pairs[moved, 1, 0] = np.nextafter(pairs[moved, 1, 0], np.float32(2.0))
    return pairs


def slivers(count: int, seed: int = 0) -> Pairs:
    """Long triangles a few float32 ulps wide, every second pair with a corner in common place."""
    rng = np.random.default_rng(seed)
    points = rng.random((count, 2, 3, 3))
    along = rng.random((count, 2, 1))
    points[:, :, 2] = points[:, :, 0] * along + points[:, :, 1] * (1 - along)
    pairs = points.astype(np.float32)
    touching = pairs[::2]
    touching[:, 1, 0] = touching[:, 0, 2]
    return pairs


def with_zero_areas(count: int, seed: int = 0) -> Pairs:
    """The first triangle has no area: a repeated corner, or three corners on a line."""
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, 8, (count, 2, 3, 3)).astype(np.float32)
    repeated = rng.random(count) < 0.5
    pairs[repeated, 0, 2] = pairs[repeated, 0, rng.integers(0, 2)]
    pairs[~repeated, 0, 2] = 2 * pairs[~repeated, 0, 1] - pairs[~repeated, 0, 0]
    return pairs


def thinned(triangles: Pairs, share: float, seed: int = 0) -> Pairs:
    """Triangles (..., 3, 3) of which a share lost its area: a corner on others, or on their line.

    Every second one of those on a line has its corner beyond the two others.
    """
    rng = np.random.default_rng(seed)
    flat = triangles.reshape(-1, 3, 3).copy()
    kind = rng.integers(0, 4, len(flat))
    kind[rng.random(len(flat)) > share] = -1
    flat[kind == 0, 2] = flat[kind == 0, 1]
    flat[kind == 1, 1:] = flat[kind == 1, :1]
    flat[kind == 2, 2] = 2 * flat[kind == 2, 1] - flat[kind == 2, 0]
    flat[kind == 3, 0] = (flat[kind == 3, 1] + flat[kind == 3, 2]) / 2
    order = np.argsort(rng.random((len(flat), 3)), axis=1)
    return flat[np.arange(len(flat))[:, None], order].reshape(triangles.shape)


def mixed_magnitudes(count: int, seed: int = 0) -> Pairs:
    """Coordinates of all sizes from 1e-12 to 1: their differences do not fit into float64.

    As on the symmetry plane of a character, where x is rounding noise and y is of order one.
    """
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-12, 0, (count, 2, 3, 3))
    points: Pairs = (sizes * rng.choice([-1.0, 1.0], sizes.shape)).astype(np.float32)
    return points


def far_corners(count: int, seed: int = 0) -> Pairs:
    """Contacts at a size of 1e-9 by triangles whose first corner is at a distance of order one.

    Coordinates relative to that corner do not fit into float64: they lose what decides.
    """
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(-1, 1, (2, count, 3, 3))
    first[:, 1:] *= 1e-9
    second = (1e-9 * second).astype(np.float32)
    weights = rng.dirichlet([1, 1, 1], count)
    first[:, 1] = np.einsum("kc,kcd->kd", weights, second)
    return np.stack([first.astype(np.float32), second], axis=1)


def scaled(pairs: Pairs, factor: float) -> Pairs:
    """The pairs with all coordinates scaled, rounded (to subnormal numbers too)."""
    return (pairs.astype(np.float64) * factor).astype(np.float32)


def shifted(pairs: Pairs, offset: float) -> Pairs:
    """The pairs moved far from the origin: few bits are left for their shape."""
    return (pairs.astype(np.float64) + offset).astype(np.float32)


def stress_families(count: int) -> dict[str, Pairs]:
    """All families by name, `count` pairs each."""
    return {
        "random": random_pairs(count, 1),
        "lattice": lattice_pairs(count, 2),
        "fine lattice": lattice_pairs(count, 3, 8),
        "flat": flat_pairs(count, 4),
        "tilted": tilted_pairs(count, 20),
        "nearly flat": nearly_flat_pairs(count, 5),
        "vertex contacts": vertex_contacts(count, 6),
        "edge contacts": edge_contacts(count, 7),
        "shared positions": shared_positions(count, 8),
        "slivers": slivers(count, 9),
        "zero areas": with_zero_areas(count, 10),
        "thin lattice": thinned(lattice_pairs(count, 21), 0.8),
        "thin in a plane": thinned(flat_pairs(count, 22), 0.6),
        "thin at random": thinned(random_pairs(count, 23), 0.3),
        "mixed magnitudes": mixed_magnitudes(count, 11),
        "far corners": far_corners(count, 12),
        "subnormal": scaled(lattice_pairs(count, 13, 6), 1.5e-45),
        "subnormal random": scaled(random_pairs(count, 14), 1e-43),
        "tiny": scaled(vertex_contacts(count, 15), 1e-36),
        "huge": scaled(vertex_contacts(count, 16), 3e38),
        "huge edges": scaled(edge_contacts(count, 17), 1e36),
        "far away": shifted(random_pairs(count, 18), 1e5),
        "far lattice": shifted(lattice_pairs(count, 19), 1e7),
    }
