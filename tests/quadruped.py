"""A four-legged animal of any proportions and resolution, with a walk: for transfer tests."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.meshes import Mesh, split_quads

Box = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@dataclass(frozen=True)
class Quadruped:
    """Proportions in metres: x forward, y up, feet at about y = 0."""

    cells: float = 16.0  # per metre
    body: float = 1.0  # half length
    width: float = 0.42  # half width
    leg: float = 0.8
    thickness: float = 0.14  # half thickness of a leg
    neck: float = 0.5
    hips: tuple[float, float] = field(default=(0.72, 0.26))  # forward and sideways

    def boxes(self) -> list[Box]:
        """Solid parts as intervals in x, y and z."""
        x, z = self.hips
        top = self.leg + 0.55
        parts: list[Box] = [
            ((-self.body, self.body), (self.leg, top), (-self.width, self.width)),
            ((self.body - 0.3, self.body), (top, top + self.neck), (-0.15, 0.15)),
            (
                (self.body - 0.3, self.body + 0.4),
                (top + self.neck, top + self.neck + 0.3),
                (-0.18, 0.18),
            ),
            ((-self.body - 0.5, -self.body), (top - 0.25, top - 0.05), (-0.1, 0.1)),
        ]
        for front in (-1, 1):
            for side in (-1, 1):
                parts.append(
                    (
                        (front * x - self.thickness, front * x + self.thickness),
                        (0.0, self.leg),
                        (side * z - self.thickness, side * z + self.thickness),
                    )
                )
        return parts

    def mesh(self) -> Mesh:
        """Closed surface (V, 3), (F, 3), smoothed, wound outward."""
        return _smoothed(*_voxel_surface(self.boxes(), self.cells))

    def landmarks(self) -> NDArray[np.float64]:
        """Anatomical points (L, 3) that all quadrupeds share: feet, knees, hips, body, head."""
        points = []
        for (x0, x1), (y0, y1), (z0, z1) in self.boxes():
            middle = ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2)
            points += [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
            points += [(x, middle[1], middle[2]) for x in (x0, x1)]
            points += [(middle[0], middle[1], z) for z in (z0, z1)]
        return np.array(points)

    def posed(
        self, points: NDArray[np.float64], swings: tuple[float, float, float, float], nod: float
    ) -> NDArray[np.float64]:
        """Points (V, 3), legs swung at the hips (radians; hind, then front) and head nodding."""
        pose = points.copy()
        legs = [(front, side) for front in (-1, 1) for side in (-1, 1)]
        below = np.clip((self.leg - points[:, 1]) / 0.4, 0.0, 1.0)
        below = below * below * (3.0 - 2.0 * below)
        for (front, side), swing in zip(legs, swings, strict=True):
            mine = (points[:, 0] * front > 0) & (points[:, 2] * side > 0)
            hip = np.array([front * self.hips[0], self.leg])
            pose = _turned(pose, hip, np.where(mine, below, 0.0) * swing)
        top = self.leg + 0.55
        rise = np.clip((points[:, 1] - top) / 0.4, 0.0, 1.0)
        rise = rise * rise * (3.0 - 2.0 * rise)
        return _turned(pose, np.array([self.body - 0.15, top]), rise * nod)

    def walk(self, points: NDArray[np.float64], frames: int) -> NDArray[np.float64]:
        """A walk cycle (frames, V, 3) in which the lowest vertex stays on the ground y = 0."""
        cycle = []
        for phase in 2 * np.pi * np.arange(frames) / frames:
            swings = tuple(0.5 * np.sin(phase + shift) for shift in (0.0, np.pi, np.pi / 2, 4.5))
            pose = self.posed(points, swings, 0.4 * np.sin(phase))
            pose[:, 0] += 0.3 * phase
            pose[:, 1] += points[:, 1].min() - pose[:, 1].min()
            cycle.append(pose)
        return np.array(cycle)


SOURCE = Quadruped()
# Other proportions, other tessellation: taller, slimmer, longer neck.
TARGET = Quadruped(
    cells=19.0, body=0.85, width=0.38, leg=1.1, thickness=0.12, neck=0.8, hips=(0.62, 0.24)
)


def markers(
    source: Quadruped,
    source_points: NDArray[np.float64],
    target: Quadruped,
    target_points: NDArray[np.float64],
) -> NDArray[np.int32]:
    """Marker pairs (K, 2): the vertices closest to the landmarks, each vertex once."""
    columns = []
    for animal, points in ((source, source_points), (target, target_points)):
        distances = np.linalg.norm(animal.landmarks()[:, None] - points[None], axis=2)
        columns.append(distances.argmin(axis=1))
    pairs = np.stack(columns, axis=1).astype(np.int32)
    for column in (0, 1):
        pairs = pairs[np.sort(np.unique(pairs[:, column], return_index=True)[1])]
    return pairs


def _turned(
    points: NDArray[np.float64], centre: NDArray[np.float64], angles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Points turned about the z axis through `centre` (x, y), each by its own angle."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, y = points[:, 0] - centre[0], points[:, 1] - centre[1]
    return np.stack(
        [centre[0] + cosine * x - sine * y, centre[1] + sine * x + cosine * y, points[:, 2]], axis=1
    )


def _voxel_surface(boxes: list[Box], cells: float) -> Mesh:
    """Boundary of the cells whose centre is in a box, two triangles a square."""
    low = np.min([[interval[0] for interval in box] for box in boxes], axis=0) - 2.0 / cells
    high = np.max([[interval[1] for interval in box] for box in boxes], axis=0) + 2.0 / cells
    low, counts = np.floor(low * cells) / cells, np.ceil((high - low) * cells).astype(int) + 1
    centres = np.meshgrid(
        *(low[k] + (np.arange(counts[k]) + 0.5) / cells for k in range(3)), indexing="ij"
    )
    solid = np.zeros(counts, dtype=bool)
    for box in boxes:
        inside = [(centres[k] >= box[k][0]) & (centres[k] <= box[k][1]) for k in range(3)]
        solid |= inside[0] & inside[1] & inside[2]
    corners = []
    for axis in range(3):
        for sign in (1, -1):
            empty = ~np.roll(solid, -sign, axis=axis)
            cell = np.argwhere(solid & empty)
            cell[:, axis] += sign > 0
            u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
            ring = [cell, cell + u, cell + u + v, cell + v]
            corners.append(np.stack(ring if sign > 0 else ring[::-1], axis=1))
    quads = np.concatenate(corners)
    unique, index = np.unique(quads.reshape(-1, 3), axis=0, return_inverse=True)
    return low + unique / cells, split_quads(index.reshape(-1, 4).astype(np.int32))


def _smoothed(points: NDArray[np.float64], faces: NDArray[np.int32], rounds: int = 4) -> Mesh:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    for _ in range(rounds):
        sums = np.zeros_like(points)
        np.add.at(sums, edges[:, 0], points[edges[:, 1]])
        counts = np.bincount(edges[:, 0], minlength=len(points))
        points = 0.5 * points + 0.5 * sums / counts[:, None]
    return points, faces
