"""The meshes of the examples: a closed tube along a curve of the x-y plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


def tube(line: ArrayLike, radius: ArrayLike, around: int = 12) -> Mesh:
    """Points (N * around + 2, 3) and the sides and caps as triangles (F, 3), wound outward.

    line: centre line (N, 2); radius: one number, or one for each point of the line (N,).
    """
    line = np.asarray(line, dtype=np.float64)
    count = len(line)
    ahead = np.gradient(line, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.stack([-ahead[:, 1], ahead[:, 0], np.zeros(count)], axis=1)
    angle = 2 * np.pi * np.arange(around) / around
    ring = np.cos(angle)[None, :, None] * side[:, None]
    ring = ring + np.sin(angle)[None, :, None] * np.array([0.0, 0.0, 1.0])
    centre = np.pad(line, ((0, 0), (0, 1)))
    rings = centre[:, None] + np.broadcast_to(radius, (count,))[:, None, None] * ring
    points = np.concatenate([rings.reshape(-1, 3), centre[[0, -1]]])

    here = np.arange(count * around).reshape(count, around)
    after = np.roll(here, -1, axis=1)
    a, b, c, d = (part.ravel() for part in (here[:-1], after[:-1], after[1:], here[1:]))
    first, last = np.full(around, count * around), np.full(around, count * around + 1)
    faces = [(a, b, c), (a, c, d), (first, after[0], here[0]), (last, here[-1], after[-1])]
    return points, np.concatenate([np.stack(face, axis=1) for face in faces]).astype(np.int32)


def arm(bend: float, rows: int = 60, around: int = 12) -> Mesh:
    """An arm of length 2 whose middle bends by `bend` radians: beyond 3 it meets itself."""
    arc = np.linspace(-1.0, 1.0, rows)
    heading = bend * np.clip(arc / 0.4 + 0.5, 0.0, 1.0)
    step = np.stack([np.cos(heading), np.sin(heading)], axis=1) * (2.0 / rows)
    return tube(np.cumsum(step, axis=0), 0.12, around)


def ball(radius: float, rows: int = 24, around: int = 24) -> Mesh:
    """A ball about the origin, its poles on the x axis."""
    angle = np.linspace(0.0, np.pi, rows + 2)[1:-1]
    line = np.stack([-radius * np.cos(angle), np.zeros(rows)], axis=1)
    return tube(line, radius * np.sin(angle), around)
