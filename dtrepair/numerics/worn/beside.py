"""What hangs beside a layer rather than beneath it: a hand beside a skirt, an arm beside a vest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import FloatArray, dots, lengths

# Least cosine between the way from the layer and its normal: above a neckline the skin lies beyond
# the rim, not in front of it.
STEEP = 0.8


def in_front(
    points: FloatArray, layer: FloatArray, outward: FloatArray, spacing: FloatArray
) -> NDArray[np.bool_]:
    """Return which points (N, 3) lie clearly outside of a layer, at rest.

    Args:
        points: Points of what the layer may lie over.
        layer: Vertices (M, 3) of the layer.
        outward: Which way is out at each of them (M, 3), unit vectors.
        spacing: Length of the edges there (M,): nearer than that nothing is clear.
    """
    if len(layer) == 0 or len(points) == 0:
        return np.zeros(len(points), dtype=bool)
    nearest = cKDTree(layer).query(points)[1]
    away = points - layer[nearest]
    height = dots(away, outward[nearest])
    return np.asarray((height > STEEP * lengths(away)) & (height > spacing[nearest]))
