"""Pressure that gives closed surfaces the volume back that contacts took."""

from __future__ import annotations

import numpy as np

from dtrepair.geometry import FloatArray, dots, lengths
from dtrepair.repair.surface import Surface, link_labels

# Highest pressure, next to edges of weight about 1 and units of the size.
HIGHEST = 5.0
# The part of the original's volume that is wanted back.
WANTED = 0.985
# The pressure goes this part of the way that a linear answer asks for, times the pull of the step.
GAIN, LEAST_PULL = 0.5, 0.3
# A closed surface has vector areas that sum to this part of its area at most.
CLOSED = 1e-2


class Inflation:
    """A pressure on each closed component, raised until it has the volume of the original."""

    def __init__(self, surface: Surface, original: FloatArray, reach: FloatArray) -> None:
        """Components of `surface`; `reach` (V,) scales the pressure at each vertex."""
        self.surface, self.reach = surface, reach
        _, self._component = np.unique(
            link_labels(surface.edges, surface.count), return_inverse=True
        )
        self._of = original
        self._areas = areas = surface.vector_areas(original)
        total = np.stack([self._sum(column) for column in areas.T], axis=1)
        closed = lengths(total) <= CLOSED * self._sum(lengths(areas))
        self._wanted = WANTED * self._volumes(original, areas)
        self._highest = np.where(closed, HIGHEST, 0.0)
        self.pressure = np.zeros(len(total))

    def force(self, points: FloatArray, pull: float) -> FloatArray:
        """Forces (V, 3) at a pose, after raising the pressures of what lacks volume."""
        areas = self.areas(points)
        lacking = self._wanted - self._volumes(points, areas)
        field = self.reach[:, None] * areas
        response = self.surface.rigidity_factor(field)
        gain = self._sum(dots(areas, response))
        change = np.divide(lacking, gain, out=np.zeros_like(gain), where=gain > 0)
        change *= GAIN * max(pull, LEAST_PULL)
        sign = np.sign(self._wanted)
        self.pressure = sign * np.clip(sign * (self.pressure + change), 0.0, self._highest)
        return self.pressure[self._component][:, None] * field

    def areas(self, points: FloatArray) -> FloatArray:
        """Vector areas (V, 3) of a pose; those of the last one are kept."""
        if points is not self._of:
            self._of, self._areas = points, self.surface.vector_areas(points)
        return self._areas

    def lost(self, points: FloatArray) -> float:
        """Missing part of the volume of all closed components."""
        volumes = self._volumes(points, self.areas(points))
        lacking = np.maximum(0.0, (self._wanted - volumes) * np.sign(self._wanted))
        closed = self._highest > 0
        total = np.abs(self._wanted[closed]).sum()
        return float(lacking[closed].sum() / total) if total > 0 else 0.0

    def _volumes(self, points: FloatArray, areas: FloatArray) -> FloatArray:
        """Signed volume of each component (divergence theorem)."""
        return self._sum(dots(points, areas)) / 3.0

    def _sum(self, values: FloatArray) -> FloatArray:
        return np.bincount(self._component, values).astype(np.float64)
