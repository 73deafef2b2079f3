"""The character of the demo, made in code: a box cage, smoothed by subdivision, moved by joints.

Lengths are metres, Y is up, the character looks along +Z. The cage is skinned (linear blends of the
joints' transforms) and then subdivided, so limbs bend smoothly and pass through the body freely.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from dtrepair.demo.subdivision import subdivide

Points = NDArray[np.float64]
Weights = Mapping[str, float]


@dataclass(frozen=True)
class DemoCharacter:
    """rest (V, 3) and quads (Q, 4) of a closed surface; points (T, V, 3) at times (T,), from 1."""

    rest: Points
    quads: NDArray[np.int32]
    times: NDArray[np.float64]
    points: Points


# Joint: its parent and the point about which it turns, for the left (+X) side; "right" is mirrored.
_JOINTS = {
    "hips": ("", (0, 0.95, 0)),
    "chest": ("hips", (0, 1.1, 0)),
    "head": ("chest", (0, 1.47, 0)),
    "left_arm": ("chest", (0.2, 1.36, 0)),
    "left_forearm": ("left_arm", (0.5, 1.36, 0)),
    "left_thigh": ("hips", (0.12, 0.85, 0)),
    "left_shin": ("left_thigh", (0.13, 0.47, 0)),
}
# Degrees about X, Y, Z of each joint at the deepest moment of the clip; the rest pose has none.
TURNS: Mapping[str, tuple[float, float, float]] = {
    "chest": (10, 0, 0),
    "head": (14, 0, 0),
    "left_arm": (66, -14, -60),
    "right_arm": (60, 20, 48),
    "left_forearm": (0, -108, 0),
    "right_forearm": (0, 108, 0),
    "left_thigh": (-5, 0, -11),
    "right_thigh": (3, 0, 7),
    "left_shin": (8, 0, 0),
}


def make_character(
    frames: int = 24, *, turns: Mapping[str, tuple[float, float, float]] = TURNS
) -> DemoCharacter:
    """Return the character: about 4,400 quads, a rest pose without intersections, `frames` poses.

    The first and the last poses are close to the rest pose; in between the arms fold into the body
    and one leg swings into the other. turns: degrees about X, Y, Z of each joint at the deepest
    moment.
    """
    cage = _build_cage()
    quads = np.asarray(cage.quads, dtype=np.int32)
    smooth = scipy.sparse.eye_array(len(cage.points), format="csr")
    for _ in range(2):
        matrix, quads = subdivide(quads, smooth.shape[0])
        smooth = matrix @ smooth
    times = np.arange(1.0, frames + 1.0)
    # 0 at both ends, 1 in the middle, at rest there: the clip can be played in a loop.
    swing = 0.5 - 0.5 * np.cos(2 * np.pi * (times - 1) / max(frames - 1, 1))
    amounts = 1 - (1 - swing) ** 1.5
    points = np.stack([smooth @ _skin(cage, turns, amount) for amount in amounts])
    return DemoCharacter(smooth @ np.asarray(cage.points), quads, times, points)


@dataclass
class _Cage:
    """A quad mesh under construction; each vertex knows its weights on the joints."""

    points: list[Points] = field(default_factory=list)
    weights: list[Weights] = field(default_factory=list)
    quads: list[list[int]] = field(default_factory=list)

    def add(self, points: Points, weights: Weights) -> list[int]:
        first = len(self.points)
        self.points.extend(points)
        self.weights.extend([weights] * len(points))
        return list(range(first, len(self.points)))

    def extrude(
        self,
        quad: int,
        centre: tuple[float, float, float],
        size: tuple[float, float],
        axes: tuple[int, int],
        weights: Weights,
    ) -> list[int]:
        """Grow a quad to a new cap of half sizes `size` along `axes`; return the side quads.

        The cap takes the quad's place in the list, so growing may go on from the same number.
        """
        ring = self.quads[quad]
        old = np.asarray([self.points[v] for v in ring])
        spread = np.sign(old - old.mean(axis=0))
        cap = np.tile(np.asarray(centre, dtype=float), (4, 1))
        for axis, half in zip(axes, size, strict=True):
            cap[:, axis] += spread[:, axis] * half
        new = self.add(cap, weights)
        first = len(self.quads)
        for k in range(4):
            j = (k + 1) % 4
            self.quads.append([ring[k], ring[j], new[j], new[k]])
        self.quads[quad] = new
        return list(range(first, first + 4))

    def facing(self, quads: list[int], direction: tuple[float, float, float]) -> int:
        """Return the one of `quads` that looks most along `direction`."""

        def along(quad: int) -> float:
            a, b, c, d = (self.points[v] for v in self.quads[quad])
            return float(np.cross(c - a, d - b) @ np.asarray(direction))

        return max(quads, key=along)


# Torso rings from below: height, half width, half depth, weights.
_TORSO: list[tuple[float, float, float, Weights]] = [
    (0.84, 0.185, 0.115, {"hips": 1}),
    (0.97, 0.170, 0.110, {"hips": 1}),
    (1.09, 0.150, 0.100, {"hips": 0.5, "chest": 0.5}),
    (1.21, 0.175, 0.120, {"chest": 1}),
    (1.29, 0.195, 0.120, {"chest": 1}),
    (1.43, 0.185, 0.095, {"chest": 1}),
]
# Arm rings: x, centre height, half height, half depth, weights. The last three are the hand.
_ARM: list[tuple[float, float, float, float, Weights]] = [
    (0.25, 1.36, 0.062, 0.066, {"chest": 0.4, "left_arm": 0.6}),
    (0.34, 1.36, 0.055, 0.056, {"left_arm": 1}),
    (0.43, 1.36, 0.050, 0.050, {"left_arm": 1}),
    (0.50, 1.36, 0.048, 0.048, {"left_arm": 0.5, "left_forearm": 0.5}),
    (0.57, 1.36, 0.047, 0.047, {"left_forearm": 1}),
    (0.66, 1.36, 0.042, 0.042, {"left_forearm": 1}),
    (0.74, 1.36, 0.033, 0.036, {"left_forearm": 1}),
    (0.80, 1.36, 0.032, 0.055, {"left_forearm": 1}),
    (0.87, 1.36, 0.030, 0.058, {"left_forearm": 1}),
    (0.95, 1.36, 0.022, 0.045, {"left_forearm": 1}),
]
# Leg rings: height, x, z of the centre, half width, half depth, weights.
_LEG: list[tuple[float, float, float, float, float, Weights]] = [
    (0.76, 0.120, 0.0, 0.078, 0.095, {"hips": 0.4, "left_thigh": 0.6}),
    (0.66, 0.123, 0.0, 0.074, 0.086, {"left_thigh": 1}),
    (0.56, 0.126, 0.0, 0.066, 0.074, {"left_thigh": 1}),
    (0.47, 0.130, 0.0, 0.058, 0.064, {"left_thigh": 0.5, "left_shin": 0.5}),
    (0.38, 0.132, -0.004, 0.058, 0.064, {"left_shin": 1}),
    (0.27, 0.134, -0.008, 0.052, 0.056, {"left_shin": 1}),
    (0.15, 0.136, -0.010, 0.042, 0.045, {"left_shin": 1}),
    (0.08, 0.138, -0.010, 0.045, 0.055, {"left_shin": 1}),
    (0.00, 0.138, -0.010, 0.050, 0.060, {"left_shin": 1}),
]
_HEAD: list[tuple[float, float, float, float, Weights]] = [
    (1.48, 0.000, 0.058, 0.062, {"chest": 0.5, "head": 0.5}),
    (1.53, 0.010, 0.060, 0.068, {"head": 1}),
    (1.57, 0.022, 0.105, 0.118, {"head": 1}),
    (1.65, 0.022, 0.135, 0.152, {"head": 1}),
    (1.75, 0.015, 0.148, 0.165, {"head": 1}),
    (1.85, 0.008, 0.130, 0.148, {"head": 1}),
    (1.90, 0.005, 0.075, 0.090, {"head": 1}),
]


def _build_cage() -> _Cage:
    cage = _Cage()
    sides, bottom, top = _build_torso(cage)
    for sign, side in (("left", 1), ("right", -1)):
        _build_arm(cage, sides[sign], side)
        _build_leg(cage, bottom[sign], side)
    head = []
    for y, z, width, depth, weights in _HEAD:
        head.append(cage.extrude(top, (0, y, z), (width, depth), (0, 2), weights))
    face = cage.facing(head[4], (0, 0, 1))
    for y, z, width, height in ((1.71, 0.172, 0.045, 0.034), (1.70, 0.222, 0.024, 0.024)):
        cage.extrude(face, (0, y, z), (width, height), (0, 1), {"head": 1})
    return cage


def _build_torso(cage: _Cage) -> tuple[dict[str, int], dict[str, int], int]:
    """Stack rings of eight vertices; return the quads the arms, legs and neck grow from."""
    across = np.array([-1, -1 / 3, 1 / 3, 1, 1, 1 / 3, -1 / 3, -1])
    deep = np.array([1, 1, 1, 1, -1, -1, -1, -1.0])
    rings = []
    for y, width, depth, weights in _TORSO:
        ring = np.stack([across * width, np.full(8, y), deep * depth], axis=1)
        rings.append(cage.add(ring, weights))
    sides = {}
    for lower, upper in pairwise(rings):
        for k in range(8):
            j = (k + 1) % 8
            if lower is rings[-2] and k in (3, 7):
                sides["left" if k == 3 else "right"] = len(cage.quads)
            cage.quads.append([lower[k], lower[j], upper[j], upper[k]])
    first = len(cage.quads)
    for k in range(3):
        cage.quads.append([rings[0][7 - k], rings[0][6 - k], rings[0][k + 1], rings[0][k]])
    for k in range(3):
        cage.quads.append([rings[-1][k], rings[-1][k + 1], rings[-1][6 - k], rings[-1][7 - k]])
    return sides, {"right": first, "left": first + 2}, first + 4


def _side(weights: Weights, side: int) -> Weights:
    if side > 0:
        return weights
    return {name.replace("left", "right"): value for name, value in weights.items()}


def _build_arm(cage: _Cage, quad: int, side: int) -> None:
    for number, (x, y, height, depth, weights) in enumerate(_ARM):
        own = _side(weights, side)
        ring = cage.extrude(quad, (side * x, y, 0), (height, depth), (1, 2), own)
        if number == len(_ARM) - 3:
            thumb = cage.facing(ring, (0, 0, 1))
    cage.extrude(thumb, (side * 0.80, 1.36, 0.085), (0.020, 0.020), (0, 1), own)
    cage.extrude(thumb, (side * 0.825, 1.36, 0.115), (0.014, 0.014), (0, 1), own)


def _build_leg(cage: _Cage, quad: int, side: int) -> None:
    for y, x, z, width, depth, weights in _LEG:
        own = _side(weights, side)
        ring = cage.extrude(quad, (side * x, y, z), (width, depth), (0, 2), own)
    foot = cage.facing(ring, (0, 0, 1))
    for z, width, height in ((0.09, 0.055, 0.032), (0.16, 0.055, 0.026), (0.21, 0.04, 0.018)):
        x = side * (0.138 + 0.2 * (z - 0.05))  # toes outwards
        cage.extrude(foot, (x, height, z), (width, height), (0, 1), own)


def _skin(cage: _Cage, turns: Mapping[str, tuple[float, float, float]], amount: float) -> Points:
    """Return the cage posed: `amount` 0 is the rest pose, 1 the deepest (linear blend skinning)."""
    transforms = _transforms(turns, amount)
    points = np.c_[np.asarray(cage.points), np.ones(len(cage.points))]
    result = np.zeros((len(points), 3))
    for name, transform in transforms.items():
        weight = np.array([weights.get(name, 0.0) for weights in cage.weights])
        result += weight[:, None] * (points @ transform.T)[:, :3]
    return result


def _transforms(
    turns: Mapping[str, tuple[float, float, float]], amount: float
) -> dict[str, Points]:
    """Return the (4, 4) transform of each joint, parents first (column vectors)."""
    mirrored = {
        name.replace("left", "right"): (parent.replace("left", "right"), (-x, y, z))
        for name, (parent, (x, y, z)) in _JOINTS.items()
        if name.startswith("left")
    }
    result: dict[str, Points] = {}
    for name, (parent, pivot) in {**_JOINTS, **mirrored}.items():
        turn = np.eye(4)
        angles = np.radians(turns.get(name, (0, 0, 0))) * amount
        turn[:3, :3] = _rotation(1, angles[1]) @ _rotation(2, angles[2]) @ _rotation(0, angles[0])
        turn[:3, 3] = np.asarray(pivot) - turn[:3, :3] @ np.asarray(pivot)
        result[name] = result[parent] @ turn if parent else turn
    return result


def _rotation(axis: int, angle: float) -> Points:
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix
