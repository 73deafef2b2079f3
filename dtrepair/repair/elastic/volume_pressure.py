"""Pressure that keeps the volume of closed surfaces: contacts take, turned creases give."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dtrepair.intersect.queries import link_labels
from dtrepair.numerics.geometry import FloatArray, dots, lengths
from dtrepair.repair.surface.surface import Surface

# Highest pressure, next to edges of weight about 1 and units of the size.
HIGHEST = 5.0
# The parts of the original's volume between which a component has no pressure.
LEAST, LARGEST = 0.985, 1.015
# The pressure goes this part of the way that a linear answer asks for, times the pull of the step.
GAIN, LEAST_PULL = 0.5, 0.3
# A closed surface has vector areas that sum to this part of its area at most.
CLOSED = 1e-2

# The motion (V, 3) that forces (V, 3) lead to.
Solve = Callable[[FloatArray], FloatArray]


class Inflation:
    """A pressure on each closed component, changed until it has the volume of the original."""

    def __init__(self, surface: Surface, original: FloatArray, reach: FloatArray) -> None:
        """Components of `surface`; `reach` (V,) scales the pressure at each vertex."""
        self.surface, self.reach = surface, reach
        _, self._first, self._component = np.unique(
            link_labels(surface.edges, surface.count), return_index=True, return_inverse=True
        )
        self._of = original
        self._areas = areas = surface.vector_areas(original)
        total = np.stack([self._sum(column) for column in areas.T], axis=1)
        closed = lengths(total) <= CLOSED * self._sum(lengths(areas))
        volumes = self._volumes(original, areas)
        self._sign, self._given = np.sign(volumes), np.abs(volumes)
        self._highest = np.where(closed, HIGHEST, 0.0)
        self.pressure = np.zeros(len(total))

    def force(self, points: FloatArray, pull: FloatArray, solve: Solve) -> FloatArray:
        """Forces (V, 3) at a pose, after changing the pressures of what has too little or much.

        `pull` (V,) is that of the last step, one number for each component; `solve` gives the
        motion (V, 3) that forces lead to.
        """
        areas = self.areas(points)
        volumes = self._sign * self._volumes(points, areas)
        right = (volumes >= LEAST * self._given) & (volumes <= LARGEST * self._given)
        if (right & (self.pressure == 0) | (self._highest == 0)).all():
            return np.zeros_like(points)
        field = self.reach[:, None] * areas
        response = solve(field)
        gain = self._sum(dots(areas, response))
        answer = np.divide(1.0, gain, out=np.zeros_like(gain), where=gain > 0)
        answer *= GAIN * np.maximum(pull[self._first], LEAST_PULL)
        # Towards the least volume from below, towards the largest from above, else back to none.
        pushing = self.pressure + answer * (LEAST * self._given - volumes)
        pulling = self.pressure + answer * (LARGEST * self._given - volumes)
        self.pressure = np.clip(pushing, 0.0, self._highest)
        self.pressure += np.clip(pulling, -self._highest, 0.0)
        return (self._sign * self.pressure)[self._component][:, None] * field

    def areas(self, points: FloatArray) -> FloatArray:
        """Vector areas (V, 3) of a pose; those of the last one are kept."""
        if points is not self._of:
            self._of, self._areas = points, self.surface.vector_areas(points)
        return self._areas

    def lost(self, points: FloatArray) -> float:
        """The part by which the volume of closed components is too small or too large."""
        volumes = self._sign * self._volumes(points, self.areas(points))
        missing = np.maximum(0.0, LEAST * self._given - volumes)
        excess = np.maximum(0.0, volumes - LARGEST * self._given)
        closed = self._highest > 0
        total = self._given[closed].sum()
        return float((missing + excess)[closed].sum() / total) if total > 0 else 0.0

    def _volumes(self, points: FloatArray, areas: FloatArray) -> FloatArray:
        """Signed volume of each component (divergence theorem)."""
        return self._sum(dots(points, areas)) / 3.0

    def _sum(self, values: FloatArray) -> FloatArray:
        return np.bincount(self._component, values).astype(np.float64)
