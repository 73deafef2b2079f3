"""Regions with a preferred direction: how far a pose strays from it, and the way back along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray, dots, lengths
from dtrepair.repair.full.acceptance import AcceptanceOptions, acceptable, changed_defects
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import BoolArray, Surface


@dataclass(frozen=True, kw_only=True)
class SteeringOptions:
    """How much a direction counts.

    Args:
        weight: Of what strays, 0 to 1, next to the distortion of a pose: as much as would be too
            distorted to be kept, so that a way that was not asked for is the last resort.
        halvings: Times that the way back to the contact is halved: to a two hundredth of it.
        patience: Iterations of the push without progress where there is a direction, which may lead
            through all of the other side before contacts become fewer.
        rings: Over which what a region keeps fades out beyond it.
    """

    weight: float = 1.0
    halvings: int = 8
    patience: int = 25
    rings: int = AcceptanceOptions.reach_rings


class Steering:
    """The directed regions of a surface; nothing is done where there are none."""

    def __init__(self, surface: Surface, *, options: SteeringOptions = SteeringOptions()) -> None:
        """Find the connected regions of vertices that have a direction."""
        self.surface, self.options = surface, options
        self.wanted = np.zeros((surface.count, 3))
        # Each with the share (V,) that it has of its surroundings.
        self.regions: list[tuple[BoolArray, FloatArray]] = []
        if surface.direction is None:
            return
        length = lengths(surface.direction)[:, None]
        np.divide(surface.direction, length, out=self.wanted, where=length > 0)
        directed = length[:, 0] > 0
        labels = surface.components(directed)
        for label in np.unique(labels[directed]):
            own = directed & (labels == label)
            away = surface.rings_from(own, options.rings)
            self.regions.append((own, 1.0 - away / options.rings))

    def __bool__(self) -> bool:
        """Tell whether anything is directed."""
        return len(self.regions) > 0

    def off(self, motion: FloatArray) -> FloatArray:
        """Return the part of a motion (V, 3) that is across the direction of each vertex."""
        across: FloatArray = motion - dots(motion, self.wanted)[:, None] * self.wanted
        return across

    def astray(self, motion: FloatArray) -> float:
        """Return the part of a motion (V, 3) of directed vertices that is not along directions.

        From 0, all along, to 1; what goes backwards is astray. 0 where nothing is directed.
        """
        astray = total = 0.0
        for own, _ in self.regions:
            along = np.maximum(dots(motion[own], self.wanted[own]), 0.0)
            astray += float(lengths(motion[own] - along[:, None] * self.wanted[own]).sum())
            total += float(lengths(motion[own]).sum())
        return astray / max(total, 1e-300)

    def steered(self, motion: FloatArray) -> FloatArray:
        """Return a motion (V, 3) by which no region as a whole leaves its line.

        Its mean across the direction is taken out, fading beyond the region: its shape is free.
        """
        for own, share in self.regions:
            motion = motion - share[:, None] * self.off(motion)[own].mean(axis=0)
        return motion

    def led_back(self, original: FloatArray, points: FloatArray, *, folds: int) -> FloatArray:
        """Return the clean pose (V, 3) with its regions back along their way to the contact.

        Their displacement is scaled by the least factor found by halving at which the pose stays
        clean: a push oversteps, and relaxing would take the shortest way back instead.
        """
        known = find_defects(self.surface, points)
        share = np.max([share for _, share in self.regions], axis=0)[:, None]
        best, low, high = points, 0.0, 1.0
        for _ in range(self.options.halvings):
            middle = 0.5 * (low + high)
            trial = points - (1.0 - middle) * share * (points - original)
            if acceptable(changed_defects(self.surface, known, points, trial), folds):
                best, high = trial, middle
            else:
                low = middle
        return best
