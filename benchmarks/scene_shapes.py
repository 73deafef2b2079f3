"""Shapes, matrices and times of the stages in `scene_stages.py`."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from tests.meshes import Mesh, split_quads


def lathe(outline: list[tuple[float, float]], around: int, *, power: float = 2.0) -> Mesh:
    """A closed surface of revolution about z from an outline of (radius, height).

    From axis to axis, bottom to top outside; an outline that never meets the axis is a ring.
    A power above 2 gives rounded squares.
    """
    corners = np.array(outline, dtype=np.float64)
    ring = corners[:, 0].min() > 0
    if ring:
        corners = np.concatenate([corners, corners[:1]])
    spacing = 2 * np.pi * corners[:, 0].max() / around
    pieces = []
    for a, b in pairwise(corners):
        count = max(1, round(float(np.linalg.norm(b - a)) / spacing))
        pieces.append(a + (b - a) * (np.arange(count) / count)[:, None])
    line = np.concatenate([*pieces, corners[-1:]])
    line = line[:-1] if ring else line[1:-1]
    angle = 2 * np.pi * np.arange(around) / around
    x, y = np.cos(angle), np.sin(angle)
    scale = (np.abs(x) ** power + np.abs(y) ** power) ** (-1 / power)
    radius, height = line[:, :1], np.broadcast_to(line[:, 1:], (len(line), around))
    points = np.stack([radius * x * scale, radius * y * scale, height], axis=2).reshape(-1, 3)
    rows = len(line) if ring else len(line) - 1
    i, j = np.meshgrid(np.arange(rows), np.arange(around), indexing="ij")
    quads = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
    index = [((p % len(line)) * around + q % around).ravel() for p, q in quads]
    faces = split_quads(np.stack(index, axis=1).astype(np.int32))
    if ring:
        return points, faces
    own, base, count = np.arange(around), rows * around, len(points)
    after = (own + 1) % around
    first = np.stack([np.full(around, count), after, own], axis=1)
    last = np.stack([np.full(around, count + 1), base + own, base + after], axis=1)
    poles = np.array([[0, 0, corners[0, 1]], [0, 0, corners[-1, 1]]])
    return np.concatenate([points, poles]), np.concatenate([faces, first, last]).astype(np.int32)


def capsule(radius: float, length: float, around: int = 24) -> Mesh:
    """A rod along z with round ends, `length` from end to end."""
    bend = np.linspace(0, np.pi / 2, 7)
    end = [(radius * np.sin(a), -length / 2 + radius * (1 - np.cos(a))) for a in bend]
    return lathe([*end, *[(r, -z) for r, z in end[::-1]]], around)


def sheet(columns: int, rows: int, width: float, height: float, thickness: float) -> Mesh:
    """A closed thin slab in the xz plane, from z = 0 up."""
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, columns + 1), np.linspace(0, 1, rows + 1))
    flat = np.stack([width * u.ravel(), np.zeros(u.size), height * v.ravel()], axis=1)
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    quads = np.stack([corner, corner + 1, corner + columns + 2, corner + columns + 1], axis=1)
    front = quads + 0
    back = quads[:, ::-1] + u.size
    grid = np.arange(u.size).reshape(rows + 1, columns + 1)
    rim = np.concatenate([grid[0], grid[1:, -1], grid[-1, -2::-1], grid[-2:0:-1, 0]])
    following = np.roll(rim, -1)
    side = np.stack([rim + u.size, following + u.size, following, rim], axis=1)
    across = np.array([0, thickness / 2, 0])
    points = np.concatenate([flat - across, flat + across])
    return points, split_quads(np.concatenate([front, back, side]).astype(np.int32))


def sword() -> Mesh:
    """A flat blade along -z with its tip at the origin's side, a guard and a grip: one surface."""
    blade, faces = lathe(
        [
            (0, -1.6),
            (0.1, -1.45),
            (0.12, 0),
            (0.34, 0.02),
            (0.34, 0.1),
            (0.07, 0.12),
            (0.07, 0.6),
            (0.1, 0.62),
            (0.1, 0.7),
            (0, 0.72),
        ],
        40,
    )
    low = np.clip(-blade[:, 2] / 0.2, 0.0, 1.0)
    blade[:, 1] *= 0.35 - 0.15 * low
    return blade, faces


def turned(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> FloatArray:
    """Matrix (4, 4) of turns about x, then y, then z, in degrees."""
    result = np.eye(4)
    for axis, angle in enumerate(np.radians([x, y, z])):
        turn = np.eye(4)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        turn[a, a] = turn[b, b] = np.cos(angle)
        turn[a, b], turn[b, a] = np.sin(angle), -np.sin(angle)
        result = result @ turn
    return result


def moved(x: float, y: float, z: float) -> FloatArray:
    """Matrix (4, 4) of a translation."""
    result = np.eye(4)
    result[3, :3] = x, y, z
    return result


def scaled(x: float, y: float, z: float) -> FloatArray:
    """Matrix (4, 4) of a scale."""
    return np.diag([x, y, z, 1.0])


def eased(count: int) -> FloatArray:
    """From 0 to 1 in `count` frames, slow at both ends."""
    t = np.linspace(0.0, 1.0, count)
    return t * t * (3.0 - 2.0 * t)


def times(first: int, count: int, step: int = 1) -> tuple[float, ...]:
    """Time codes."""
    return tuple(float(first + step * k) for k in range(count))
