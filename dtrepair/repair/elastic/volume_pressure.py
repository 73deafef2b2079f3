"""Pressure that keeps the volume of closed surfaces: contacts take, turned creases give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.geometry import FloatArray, dots, extents, lengths
from dtrepair.repair.surface.surface import Surface

# The motion (V, 3) that forces (V, 3) lead to.
Solve = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, kw_only=True)
class PressureOptions:
    """Numbers of the pressure that keeps volumes.

    Args:
        highest: Highest pressure, next to edges of weight about 1 and units of the component's own
            extent at rest; above it skin balloons between contacts.
        least_volume: Fraction of the original's volume below which a component gets pressure.
        largest_volume: Fraction above which it gets suction. Between both there is no pressure, so
            that what kept its volume is left alone.
        gain: Fraction of the way that a linear answer asks for, taken in a step times its pull:
            full steps overshoot, as contacts answer less than linearly.
        least_pull: The pull counts as this at least, so that volume comes back in short steps too.
        closed: A surface is closed if its vector areas sum to at most this fraction of its area.
    """

    highest: float = 5.0
    least_volume: float = 0.985
    largest_volume: float = 1.015
    gain: float = 0.5
    least_pull: float = 0.3
    closed: float = 1e-2


class VolumePressure:
    """A pressure on each closed component, changed until it has the volume of the original."""

    def __init__(
        self,
        surface: Surface,
        original: FloatArray,
        reach: FloatArray,
        *,
        options: PressureOptions = PressureOptions(),
    ) -> None:
        """Take the components of `surface`; `reach` (V,) scales the pressure at each vertex."""
        self.options = options
        self.surface, self.reach = surface, reach
        _, self._first, self._component = np.unique(
            link_labels(surface.edges, surface.count, device=surface.device),
            return_index=True,
            return_inverse=True,
        )
        self._of = original
        self._areas = areas = surface.vector_areas(original)
        total = np.stack([self._sum(column) for column in areas.T], axis=1)
        closed = lengths(total) <= options.closed * self._sum(lengths(areas))
        volumes = self._volumes(original, areas)
        self._sign, self._given = np.sign(volumes), np.abs(volumes)
        # Finer skins have more gaps to be pressed open.
        highest = options.highest * surface.fineness**2
        self._highest = np.where(closed, highest / self._extents(), 0.0)
        self.pressure = np.zeros(len(total))

    def force(self, points: FloatArray, pull: FloatArray, solve: Solve) -> FloatArray:
        """Change the pressures of components of a wrong volume; return the forces (V, 3) at a pose.

        `pull` (V,) is that of the last step, one number for each component; `solve` gives the
        motion (V, 3) that forces lead to.
        """
        areas, options = self.areas(points), self.options
        least, largest = options.least_volume * self._given, options.largest_volume * self._given
        volumes = self._sign * self._volumes(points, areas)
        kept = (volumes >= least) & (volumes <= largest)
        if (kept & (self.pressure == 0) | (self._highest == 0)).all():
            return np.zeros_like(points)
        field = self.reach[:, None] * areas
        response = solve(field)
        gain = self._sum(dots(areas, response))
        answer = np.divide(1.0, gain, out=np.zeros_like(gain), where=gain > 0)
        answer *= options.gain * np.maximum(pull[self._first], options.least_pull)
        # Towards the least volume from below, towards the largest from above, else back to none.
        pushing = self.pressure + answer * (least - volumes)
        pulling = self.pressure + answer * (largest - volumes)
        self.pressure = np.clip(pushing, 0.0, self._highest)
        self.pressure += np.clip(pulling, -self._highest, 0.0)
        return (self._sign * self.pressure)[self._component][:, None] * field

    def areas(self, points: FloatArray) -> FloatArray:
        """Return the vector areas (V, 3) of a pose; those of the last pose are remembered."""
        if points is not self._of:
            self._of, self._areas = points, self.surface.vector_areas(points)
        return self._areas

    def lost(self, points: FloatArray) -> float:
        """Return the fraction by which closed components have too little or too much volume."""
        options = self.options
        volumes = self._sign * self._volumes(points, self.areas(points))
        missing = np.maximum(0.0, options.least_volume * self._given - volumes)
        excess = np.maximum(0.0, volumes - options.largest_volume * self._given)
        closed = self._highest > 0
        total = self._given[closed].sum()
        return float((missing + excess)[closed].sum() / total) if total > 0 else 0.0

    def _extents(self) -> FloatArray:
        """Return the largest coordinate range of each component at rest."""
        # To some digits: what is all there is has the extent 1.
        found = np.round(extents(self.surface.rest, self._component), 9)
        return np.where(found > 0.0, found, 1.0)

    def _volumes(self, points: FloatArray, areas: FloatArray) -> FloatArray:
        """Return the signed volume of each component (divergence theorem)."""
        return self._sum(dots(points, areas)) / 3.0

    def _sum(self, values: FloatArray) -> FloatArray:
        return np.bincount(self._component, values).astype(np.float64)
