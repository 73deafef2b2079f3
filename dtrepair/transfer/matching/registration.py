"""Registration: the source's rest deformed onto the target's, from marker vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    as_mesh,
    components,
    diagonal,
    shared_edges,
    vector_areas,
)
from dtrepair.numerics.operators import Factor
from dtrepair.numerics.threads import one_thread
from dtrepair.transfer.arrays import Array, floating_type, like, to_numpy
from dtrepair.transfer.gradients import deformation_operator, degenerate_triangles
from dtrepair.transfer.matching.alignment import similarity
from dtrepair.transfer.matching.closest_point import ClosestSurface
from dtrepair.transfer.matching.markers import checked_markers


@dataclass(frozen=True, kw_only=True)
class RegistrationOptions:
    """Weights of the registration; the meshes have unit size, so they suit all.

    Args:
        smoothness: Of the differences between the deformations of neighbours (Sumner & Popovic
            2004, section 4.1).
        identity: Of the deformations themselves: small, it only settles what is free.
        closest: Of the closest-point term, one solve each: from none, as closest points are wrong
            at first, to where it rules.
        neighbors: Triangles of the target looked at for each closest point, those of the nearest
            centroids: the nearest may face away.

    Raises:
        ValueError: no weight, a negative one, or no neighbour.
    """

    smoothness: float = 1.0
    identity: float = 1e-3
    closest: tuple[float, ...] = (0.0, 1.0, 10.0, 50.0, 250.0, 1000.0, 5000.0)
    neighbors: int = 16

    def __post_init__(self) -> None:
        """Check the weights."""
        if not self.closest or min(self.closest) < 0:
            raise ValueError(
                f"closest should be weights of 0 or more, at least one, got {self.closest}"
            )
        if self.neighbors < 1:
            raise ValueError(f"neighbors should be at least 1, got {self.neighbors}")


@one_thread()
def register(
    source: Array,
    source_faces: Array,
    target: Array,
    target_faces: Array,
    markers: Array,
    *,
    options: RegistrationOptions = RegistrationOptions(),
) -> Array:
    """Return the source rest (Vs, 3) deformed onto the target (Sumner & Popovic 2004, eq. 11).

    Minimises  smoothness * sum over neighbours |T_i - T_j|^2 + identity * sum |T_i - I|^2 +
    closest * sum |v_i - c_i|^2  over positions and fourth vertices, the markers (K, 2) of (source
    vertex, target vertex) held exactly; once for each weight in `closest`, c_i being the closest
    point of the target with a normal within 90 degrees among the triangles of the `neighbors`
    nearest centroids. The source is aligned by the markers and brought to unit size first, so the
    weights mean the same for all meshes. Raises ValueError for markers that are given twice, out
    of range, too few or on a line.
    """
    mesh = as_mesh(to_numpy(source), to_numpy(source_faces))
    goal = as_mesh(to_numpy(target), to_numpy(target_faces))
    rows = checked_markers(markers, len(mesh[0]), len(goal[0]))
    system = RegistrationSystem(mesh, goal, rows, options=options)
    surface = ClosestSurface(system.target, goal[1], options.neighbors)
    points = system.aligned
    for weight in options.closest:
        if weight > 0:
            attracted, valid = surface(points, _vertex_normals(points, system.usable_faces))
            points = system.solve(np.where(valid, weight, 0.0), attracted)
        else:
            points = system.solve(np.zeros(len(points)), points)
    result = system.in_target_units(points).astype(floating_type(to_numpy(source)), copy=False)
    return like(result, source)


class RegistrationSystem:
    """The quadratic part of the registration with its markers eliminated, at unit target size.

    Unknowns are the source positions and the offsets of the fourth vertices, (Vs + Fs, 3): the
    smoothness term couples the normal columns of neighbours, so they cannot be eliminated.
    """

    def __init__(
        self,
        source: tuple[FloatArray, IntArray],
        target: tuple[FloatArray, IntArray],
        markers: IntArray,
        *,
        options: RegistrationOptions = RegistrationOptions(),
    ) -> None:
        """`markers` (K, 2) as `checked_markers` returns them."""
        self.markers = markers
        align = similarity(source[0][markers[:, 0]], target[0][markers[:, 1]])
        self._centre, self._size = target[0].mean(axis=0), diagonal(target[0])
        self.target = (target[0] - self._centre) / self._size
        self.aligned = (align(source[0]) - self._centre) / self._size
        degenerate = degenerate_triangles(self.aligned, source[1])
        self.usable_faces = source[1][~degenerate]
        self.matrix, self.right = _smoothness_system(
            self.aligned,
            source[1],
            degenerate,
            markers[:, 0],
            smoothness=options.smoothness,
            identity=options.identity,
        )
        self.fixed = markers[:, 0].astype(np.int64)
        self.values = self.target[markers[:, 1]]
        free = np.ones(self.matrix.shape[0], dtype=bool)
        free[self.fixed] = False
        self.free = np.flatnonzero(free)
        rows = self.matrix[self.free]
        self.free_matrix = rows[:, self.free].tocsc()
        self.coupling = rows[:, self.fixed].tocsr()

    def solve(self, weights: FloatArray, attracted: FloatArray) -> FloatArray:
        """Return positions (Vs, 3), each drawn to `attracted` (Vs, 3) by `weights` (Vs,)."""
        count = len(self.aligned)
        diagonal_terms = np.zeros(self.matrix.shape[0])
        diagonal_terms[:count] = weights
        right = self.right.copy()
        right[:count] += weights[:, None] * attracted
        right = right[self.free] - self.coupling @ self.values
        factor = Factor(self.free_matrix + sparse.diags(diagonal_terms[self.free]))
        solution = np.empty((self.matrix.shape[0], 3))
        solution[self.fixed] = self.values
        solution[self.free] = factor(right)
        return solution[:count]

    def in_target_units(self, points: FloatArray) -> FloatArray:
        """Return positions (V, 3) at unit size in the target's units."""
        restored: FloatArray = points * self._size + self._centre
        return restored


def _smoothness_system(
    points: FloatArray,
    faces: IntArray,
    degenerate: NDArray[np.bool_],
    marked: IntArray,
    *,
    smoothness: float,
    identity: float,
) -> tuple[sparse.csr_matrix, FloatArray]:
    """Return matrix (V + F, V + F) and right side (V + F, 3) of smoothness and identity terms.

    A degenerate triangle has no gradient: its edges are kept as weakly as the identity term, and
    its middle corner stays at its place on the longest edge. This, and what ties a loose piece,
    weighs as much as the smoothness: nothing else fixes them before points attract, and a weak
    term would make the matrix ill-conditioned.
    """
    gradients = deformation_operator(points, faces, degenerate)
    links = shared_edges(faces)
    links = links[~degenerate[links].any(axis=1)]
    rows = np.arange(len(links))
    jumps = sparse.coo_matrix(
        (
            np.concatenate([np.ones(len(links)), -np.ones(len(links))]),
            (np.concatenate([rows, rows]), links.T.ravel()),
        ),
        shape=(len(links), len(faces)),
    )
    jump = sparse.kron(jumps, sparse.eye(3), format="csr") @ gradients
    matrix = smoothness * (jump.T @ jump) + identity * (gradients.T @ gradients)
    right = identity * (gradients.T @ np.tile(np.eye(3), (len(faces), 1)))
    # The fourth vertex of a degenerate triangle is in no equation: any positive entry will do.
    matrix = matrix + sparse.diags(np.concatenate([np.zeros(len(points)), 1.0 * degenerate]))
    slivers = faces[degenerate]
    for terms, weight in (
        (_edges(points, slivers.ravel(), np.roll(slivers, -1, axis=1).ravel()), identity),
        (_places_on_edges(points, slivers), smoothness + identity),
        (_ties(points, faces, marked), smoothness + identity),
    ):
        padded = sparse.hstack([terms, sparse.csr_matrix((terms.shape[0], len(faces)))])
        matrix = matrix + weight * (padded.T @ padded)
        right += weight * (padded.T @ (terms @ points))
    return matrix.tocsr(), right


def _ties(points: FloatArray, faces: IntArray, marked: IntArray) -> sparse.csr_matrix:
    """Return edges (E, V) from pieces without a marker, and unused vertices, to a piece with one.

    They join the closest vertices.
    """
    labels = components(faces, len(points))
    held = np.isin(labels, labels[marked])
    loose, body = np.flatnonzero(~held), np.flatnonzero(held)
    distances, nearest = cKDTree(points[body]).query(points[loose])
    order = np.lexsort((distances, labels[loose]))
    chosen = order[np.unique(labels[loose][order], return_index=True)[1]]
    return _edges(points, body[nearest[chosen]], loose[chosen])


def _edges(
    points: FloatArray, first: NDArray[np.integer], second: NDArray[np.integer]
) -> sparse.csr_matrix:
    """Return the operator (E, V): the second point of each edge minus the first."""
    rows = np.arange(len(first))
    signs = np.concatenate([np.ones(len(first)), -np.ones(len(first))])
    ends = (np.concatenate([rows, rows]), np.concatenate([second, first]))
    return sparse.coo_matrix((signs, ends), (len(first), len(points))).tocsr()


def _places_on_edges(points: FloatArray, slivers: IntArray) -> sparse.csr_matrix:
    """Return the operator (S, V): a sliver's middle corner minus its place on the longest edge.

    A vertex that only slivers use follows its neighbours by these rows.
    """
    corners = points[slivers]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    middle = np.einsum("fij,fij->fi", opposite, opposite).argmax(axis=1)
    ordered = slivers[np.arange(len(slivers))[:, None], (middle[:, None] + np.arange(3)) % 3]
    top, start, end = (points[ordered[:, corner]] for corner in range(3))
    squared = np.einsum("ij,ij->i", end - start, end - start)
    along = np.einsum("ij,ij->i", top - start, end - start)
    fraction = np.divide(along, squared, out=np.zeros_like(along), where=squared > 0)
    weights = np.stack([np.ones(len(slivers)), fraction - 1.0, -fraction], axis=1)
    rows = np.repeat(np.arange(len(slivers)), 3)
    shape = (len(slivers), len(points))
    return sparse.coo_matrix((weights.ravel(), (rows, ordered.ravel())), shape).tocsr()


def _vertex_normals(points: FloatArray, faces: IntArray) -> FloatArray:
    """Return area-weighted vertex normals (V, 3), not normalised: only their direction counts."""
    vectors = np.repeat(vector_areas(points, faces), 3, axis=0)
    return np.stack(
        [np.bincount(faces.ravel(), vectors[:, axis], len(points)) for axis in range(3)], axis=1
    )
