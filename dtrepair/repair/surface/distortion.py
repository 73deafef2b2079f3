"""How far a pose of a surface is from its original: one number, smaller is better."""

from __future__ import annotations

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import displacements, edge_log_ratio
from dtrepair.repair.surface.surface import Surface


def distortion(surface: Surface, original: FloatArray, points: FloatArray) -> float:
    """Edge log-ratio rms + 2 x mean displacement over the diagonal, of a pose (V, 3): no unit.

    Repairs lower it, and stages report it.
    """
    moved = float(displacements(original, points).mean())
    return edge_log_ratio(original, points, surface.edges) + 2.0 * moved
