"""The smallest elastic motion of a small region that changes some of its measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.surface.surface import Surface

# Of the dense system, next to its mean diagonal: measures that share vertices ask for nearly the
# same motion.
REGULARIZATION = 1e-6


class LeastMotion:
    """Motions of a region of a surface; built once for several steps.

    Args:
        surface: The surface.
        chosen: The vertices (V,) around which the region lies.
        rings: It reaches so many rings of edges beyond them, without what is stiff.
        largest: Of a vertex in a step, mean edge lengths.
    """

    def __init__(
        self, surface: Surface, chosen: NDArray[np.bool_], rings: int, *, largest: float
    ) -> None:
        inner = np.flatnonzero(surface.dilate(chosen, rings) & ~surface.stiff)
        self._inner, self._largest = inner, largest * surface.edge_length
        self._place = np.full(surface.count, -1)
        self._place[inner] = np.arange(len(inner))
        anchor = sparse.diags(surface.options.anchor * surface.mass[inner])
        self._solve = linalg.splu((surface.laplacian[inner][:, inner] + anchor).tocsc()).solve

    def meets(self, corners: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which of some sets of vertices (N, K) the region holds a vertex of."""
        meets: NDArray[np.bool_] = (self._place >= 0)[corners].any(axis=1)
        return meets

    def step(
        self,
        points: FloatArray,
        corners: NDArray[np.integer],
        gradients: FloatArray,
        changes: FloatArray,
    ) -> FloatArray:
        """Return the pose (V, 3) after the motion x of least tr(x^T (L + anchor M) x).

        It changes measures of the vertices `corners` (N, K), with gradients (N, K, 3), by
        `changes` (N,) in first order, or less where a vertex would move too far.
        """
        count, place = len(self._inner), self._place[corners]
        # What lies outside is gathered in one more row and left out.
        columns = np.zeros((count + 1, len(changes), 3))
        numbers = np.arange(len(changes))
        for corner in range(corners.shape[1]):
            columns[place[:, corner], numbers] += gradients[:, corner]
        columns = columns[:count]
        answers = self._solve(columns.reshape(count, -1)).reshape(columns.shape)
        system = np.einsum("vid,vjd->ij", columns, answers)
        system += (REGULARIZATION * np.trace(system) / len(changes) + 1e-30) * np.eye(len(changes))
        motion = np.einsum("vid,i->vd", answers, np.linalg.solve(system, changes))
        motion *= min(1.0, self._largest / max(lengths(motion).max(), 1e-300))
        moved = points.copy()
        moved[self._inner] += motion
        return moved
