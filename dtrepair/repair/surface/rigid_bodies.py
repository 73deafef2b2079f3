"""Bodies that only move as a whole: the limit of a diffusion that spreads without end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray


@dataclass(frozen=True, kw_only=True)
class RigidOptions:
    """Numbers of rigid motions.

    Args:
        flat: Moments of inertia below this fraction of the largest count as none: a rod does not
            spin.
        rounding: What differs from a rigid motion by less than this fraction of its coordinates is
            one.
        shorter: Factor by which a motion is shortened until no vertex goes too far ...
        tries: ... at most so often; then the body stays.
    """

    flat: float = 1e-6
    rounding: float = 1e-12
    shorter: float = 0.97
    tries: int = 60


class RigidBodies:
    """The vertex ranges of the rigid bodies of a surface.

    Args:
        ranges: (first vertex, last vertex + 1) of each rigid body.
        mass: Lumped masses of all vertices (V,).
    """

    def __init__(
        self,
        ranges: Sequence[tuple[int, int]],
        mass: FloatArray,
        *,
        options: RigidOptions = RigidOptions(),
    ) -> None:
        self._options = options
        self.slices = tuple(slice(first, stop) for first, stop in ranges)
        self.mass = mass
        self.mask = np.zeros(len(mass), dtype=bool)
        for own in self.slices:
            self.mask[own] = True

    def moved(self, points: FloatArray, field: FloatArray, others: FloatArray) -> FloatArray:
        """Return `others` (V, 3 n) with the rigid part of a field of forces where bodies are rigid.

        points: the pose (V, 3); field: the forces (V, 3 n).

        Of all velocities a + w x (x - centre) the one that the forces do the most work for, in the
        metric of the masses: force over mass, torque over the moments of inertia.
        """
        result = others.copy() if self.slices else others
        for own in self.slices:
            result[own] = 0.0
            if field.shape[1] % 3 or not field[own].any():
                continue
            mass = self.mass[own]
            force = field[own].reshape(len(mass), -1, 3)
            arm = points[own] - mass @ points[own] / mass.sum()
            squared = (arm**2).sum(axis=1)
            inertia = np.diag(np.full(3, mass @ squared)) - (mass[:, None] * arm).T @ arm
            torque = np.cross(arm[:, None], force).sum(axis=0)
            spin = torque @ np.linalg.pinv(inertia, rcond=self._options.flat, hermitian=True)
            shift = force.sum(axis=0) / mass.sum()
            result[own] = (shift + np.cross(spin[None], arm[:, None])).reshape(len(arm), -1)
        return result

    def fitted(self, reference: FloatArray, points: FloatArray) -> FloatArray:
        """Return the pose (V, 3) with rigid bodies replaced by rigid motions of `reference`.

        The least sum of squares, weighted by mass (Kabsch 1976). A body that did not move, or
        moved as a whole already, keeps every bit.
        """
        if not self.slices:
            return points
        result = points.copy()
        for own in self.slices:
            before, after, mass = reference[own], points[own], self.mass[own]
            if np.array_equal(before, after):
                continue
            first, second = mass @ before / mass.sum(), mass @ after / mass.sum()
            spread = (mass[:, None] * (before - first)).T @ (after - second)
            left, _, right = np.linalg.svd(spread)
            left[:, 2] *= np.sign(np.linalg.det(left @ right))
            nearest = (before - first) @ (left @ right) + second
            if np.abs(nearest - after).max() > self._options.rounding * np.abs(after).max():
                result[own] = nearest
        return result

    def shortened(self, original: FloatArray, points: FloatArray, farthest: float) -> FloatArray:
        """Return the pose with rigid motions shortened until none goes beyond `farthest`."""
        result = points.copy()
        for own in self.slices:
            length = float(np.linalg.norm(points[own] - original[own], axis=1).max())
            part = min(1.0, farthest / max(length, 1e-300))
            trial = points
            for _ in range(self._options.tries):
                if np.linalg.norm(trial[own] - original[own], axis=1).max() <= farthest:
                    break
                trial = self.fitted(original, original + part * (points - original))
                part *= self._options.shorter
            else:
                trial = original
            result[own] = trial[own]
        return result


def allowed(
    rigid: RigidBodies, original: FloatArray, points: FloatArray, farthest: float | None = None
) -> FloatArray:
    """Return the pose (V, 3) near `points` that a repair of `original` may end with.

    Rigid bodies move as a whole, and no vertex farther than a limit, if there is one.
    """
    points = rigid.fitted(original, points)
    if farthest is None:
        return points
    # A little less than the limit: rounding to float32 must not exceed it.
    limit = farthest * (1.0 - 1e-6)
    moved = points - original
    length = np.linalg.norm(moved, axis=1, keepdims=True)
    shorter = original + moved * (limit / np.maximum(length, 1e-300))
    shorter = np.where((length > limit) & ~rigid.mask[:, None], shorter, points)
    return rigid.shortened(original, shorter, limit)
