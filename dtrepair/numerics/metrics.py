"""How far a repaired mesh is from its input: displacement, edge lengths, jitter, jumps, volume."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    cross,
    diagonal,
    dots,
    lengths,
    vector_areas,
)

BoolArray = NDArray[np.bool_]


def displacements(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return how far each vertex moved (V,), relative to the bounding-box diagonal of `before`."""
    return lengths(after - before) / (diagonal(before) or 1.0)


def edge_log_ratio(before: FloatArray, after: FloatArray, edges: IntArray) -> float:
    """Return the root mean square of the logarithm of the edges' length ratios.

    It is 0 for a rigid motion; edges shorter than rounding errors count as that long.
    before, after: (V, 3); edges: (E, 2).
    """
    if len(edges) == 0:
        return 0.0
    first, second = edges.T
    old, new = (lengths(p.take(first, axis=0) - p.take(second, axis=0)) for p in (before, after))
    floor = 1e-6 * (diagonal(before) or 1.0)
    return float(np.sqrt(np.mean(np.log(np.maximum(new, floor) / np.maximum(old, floor)) ** 2)))


def distortion(before: FloatArray, after: FloatArray, edges: IntArray) -> float:
    """Return the edge log-ratio rms + 2 x the mean displacement over the diagonal: no unit.

    Repairs lower it, and stages report it. before, after: (V, 3); edges: (E, 2).
    """
    moved = float(displacements(before, after).mean())
    return edge_log_ratio(before, after, edges) + 2.0 * moved


def normal_consistency(before: FloatArray, after: FloatArray, faces: IntArray) -> float:
    """Return the mean cosine between the normals of triangles (F, 3) before and after, by area.

    1 for a motion that turns nothing. Triangles that have no area in either pose are left out.
    """
    first, second = vector_areas(before, faces), vector_areas(after, faces)
    sizes = lengths(first), lengths(second)
    solid = (sizes[0] > 0) & (sizes[1] > 0)
    if not solid.any():
        return 1.0
    cosines = dots(first, second)[solid] / (sizes[0] * sizes[1])[solid]
    return float(np.average(cosines, weights=sizes[0][solid]))


def volume(points: FloatArray, faces: IntArray) -> float:
    """Return the signed volume of a closed mesh, cubed length units (divergence theorem)."""
    a, b, c = (points[faces[:, k]] - points.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, cross(b, c)) / 6.0)


def jitter(before: FloatArray, after: FloatArray) -> float:
    """Return the root mean square second difference of the displacement (T, V, 3), in diagonals."""
    moved = after - before
    if len(moved) < 3:
        return 0.0
    second = moved[2:] - 2.0 * moved[1:-1] + moved[:-2]
    return float(np.sqrt(np.mean(np.sum(second**2, axis=2))) / (diagonal(before[0]) or 1.0))


class JitterMeter:
    """Measures the root mean square second difference of the displacement, in diagonals.

    The same figure as `jitter`, in memory that does not grow with the number of frames.
    """

    def __init__(self) -> None:
        self._last: list[NDArray[np.float64]] = []
        self._diagonal = 0.0
        self._sum = 0.0
        self._count = 0

    def add(self, before: ArrayLike, after: ArrayLike) -> None:
        """Take the next frame: points (V, 3) of the input and of the result."""
        original = np.asarray(before, dtype=np.float64)
        if not self._last:
            self._diagonal = diagonal(original) or 1.0
        self._last.append(np.asarray(after, dtype=np.float64) - original)
        if len(self._last) == 3:
            first, middle, last = self._last
            second = first - 2 * middle + last
            self._sum += float((second**2).sum())
            self._count += len(second)
            self._last.pop(0)

    @property
    def value(self) -> float:
        """The jitter of the frames so far; 0 for fewer than three frames."""
        return float(np.sqrt(self._sum / self._count)) / self._diagonal if self._count else 0.0


@dataclass(frozen=True, kw_only=True)
class JumpOptions:
    """What counts as a jump.

    Args:
        farther: A vertex jumps by how much farther its displacement is from that between its
            neighbours in time than these are from the middle between them. A frame jumps where
            that is more than this fraction of the diagonal ...
        opposed: ... or twice as far as its displacement, or that before it, points against the
            other is more than this: it goes to the other side ...
        quantile: ... for all but this fraction of the vertices.
    """

    farther: float = 0.01
    opposed: float = 0.005
    quantile: float = 0.995


class JumpMeter:
    """Measures by how much the displacements of frames stand out, in memory for three frames.

    A correction that grows or fades, however fast, is no jump: the displacement between two others
    may be as far from both as they are from each other. One that changes sides is, even for good.

    Args:
        part_of: The part (V,) of each vertex: a belt may jump on a body that does not.
        options: What counts as a jump.
    """

    def __init__(
        self, part_of: ArrayLike | None = None, *, options: JumpOptions = JumpOptions()
    ) -> None:
        self.options, self._parts = options, list[Any]([slice(None)])
        if part_of is not None:
            order = np.argsort(part_of, kind="stable")
            ends = np.flatnonzero(np.diff(np.asarray(part_of)[order])) + 1
            self._parts = np.split(order, ends)
        self._last: list[tuple[float, FloatArray]] = []
        self._diagonal = 0.0
        # The parts that jump in the frame before.
        self._jumped = np.zeros(len(self._parts), dtype=bool)
        # By how much frames jump, fractions of the diagonal of the first one, by their times.
        self.jumps: dict[float, float] = {}

    def add(self, time: float, before: ArrayLike, after: ArrayLike) -> None:
        """Take the next frame: its time, points (V, 3) of the input and of the result.

        One that is not after the one before in time begins anew.
        """
        if self._last and not time > self._last[-1][0]:
            self.restart()
        original = np.asarray(before, dtype=np.float64)
        self._diagonal = self._diagonal or diagonal(original) or 1.0
        self._last.append((time, np.asarray(after, dtype=np.float64) - original))
        self._last = self._last[-3:]
        if len(original) == 0:
            return
        if len(self._last) == 3:
            (first, left), (middle, own), (last, right) = self._last
            between = left + (middle - first) / (last - first) * (right - left)
            farther = lengths(own - between) - 0.5 * lengths(right - left)
            self._jumped |= self._tell(middle, farther, self.options.farther)
        if len(self._last) > 1:
            left, right = (own for _, own in self._last[-2:])
            longer = np.maximum(lengths(left), lengths(right))
            against = -dots(left, right) / np.maximum(longer, np.finfo(float).tiny)
            # A part that stood out comes back.
            asked = ~self._jumped
            self._jumped = self._tell(time, 2.0 * against, self.options.opposed, asked)

    def restart(self) -> None:
        """Begin anew: what follows is no neighbour of the frames so far."""
        self._last.clear()
        self._jumped[:] = False

    def _tell(
        self, time: float, farther: FloatArray, least: float, asked: BoolArray | None = None
    ) -> BoolArray:
        """Note a frame whose vertices jump so far (V,), where that is more than the least.

        Return the parts that do, of those (P,) that are asked for.
        """
        result = np.zeros(len(self._parts), dtype=bool)
        for place, part in enumerate(self._parts):
            own = farther[part] / self._diagonal
            if (asked is None or asked[place]) and own.max() > least:
                jump = float(np.quantile(own, self.options.quantile))
                result[place] = jump > least
                if result[place]:
                    self.jumps[time] = max(jump, self.jumps.get(time, least))
        return result
