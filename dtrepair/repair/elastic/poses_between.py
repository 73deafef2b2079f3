"""Poses on the way from the rest of a surface to one of its poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial.transform import Rotation

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class BetweenOptions:
    """Numbers of the poses between.

    Args:
        anchor: Weight of the pull to where the whole is, which edges do not tell, next to them: so
            weak that limbs are not drawn in.
    """

    anchor: float = 1e-6


class PosesBetween:
    """Interpolates between the rest of a surface and a pose, as rigidly as possible.

    The surroundings of each vertex turn about an axis of their own, and stretch linearly (Alexa,
    Cohen-Or, Levin 2000); of the rotations of an angle, one more or one less turn, that nearest to
    the neighbour's is taken. The rest is first led to the pose as a whole.

    Attributes:
        start: The rest (V, 3), led to the pose as a whole, in units of the surface's size.
    """

    def __init__(
        self, surface: Surface, pose: FloatArray, *, options: BetweenOptions = BetweenOptions()
    ) -> None:
        """Prepare for poses between the rest and `pose` (V, 3), in units of the surface's size."""
        whole = RigidBodies([(0, surface.count)], surface.mass)
        self._pose = pose
        self.start = whole.fitted(surface.rest, pose)
        rotations = ArapSystem(surface, self.start).rotations(pose)
        self._turns = unwound(surface.laplacian, Rotation.from_matrix(rotations).as_rotvec())
        laplacian = surface.laplacian.tocoo()
        edges = laplacian.row != laplacian.col
        first, second = laplacian.row[edges], laplacian.col[edges]
        self._ends, self._weights = (first, second), -laplacian.data[edges]
        self._before = self.start[first] - self.start[second]
        after = pose[first] - pose[second]
        # Turned back by the surroundings of either end.
        self._unturned = [np.einsum("eji,ej->ei", rotations[end], after) for end in self._ends]
        self._anchor = options.anchor * surface.mass
        self._solve = surface.factor(surface.laplacian + sparse.diags(self._anchor))

    def __call__(self, share: float) -> FloatArray:
        """Return the pose (V, 3) at a share of the way: 0 is the rest, led there, 1 the pose."""
        if share == 1.0:
            return self._pose
        turned = Rotation.from_rotvec(share * self._turns).as_matrix()
        edges = np.zeros_like(self._before)
        for end, own in zip(self._ends, self._unturned, strict=True):
            stretched = (1.0 - share) * self._before + share * own
            edges += 0.5 * np.einsum("eij,ej->ei", turned[end], stretched)
        pull = self._weights[:, None] * edges
        first, count = self._ends[0], len(self._pose)
        right = np.stack([np.bincount(first, own, minlength=count) for own in pull.T], axis=1)
        home = (1.0 - share) * self.start + share * self._pose
        return self._solve(right + self._anchor[:, None] * home)


def unwound(graph: sparse.csr_matrix, turns: FloatArray) -> FloatArray:
    """Return rotation vectors (V, 3) of the same rotations that vary least from vertex to vertex.

    A rotation vector of an angle stands for the same rotation as one of a full turn more or less.
    From the vertex of a component that turns least, neighbours follow each other.

    graph: which vertices (V, V) are neighbours; turns: by at most half a turn.
    """
    result, angle = turns.copy(), lengths(turns)
    count, component = csgraph.connected_components(graph, directed=False)
    farthest = np.zeros(count)
    np.maximum.at(farthest, component, angle)
    # Between vertices that turn by a quarter at most no full turn is ever nearer.
    winding = farthest[component] > 0.5 * np.pi
    if not winding.any():
        return result
    order = np.lexsort((angle, component))
    firsts = order[np.unique(component[order], return_index=True)[1]]
    firsts = firsts[winding[firsts]]
    root = len(turns)
    starts = sparse.coo_matrix(
        (np.ones(len(firsts)), (np.full(len(firsts), root), firsts)), shape=(root + 1, root + 1)
    )
    joined = sparse.block_diag([graph, sparse.csr_matrix((1, 1))], format="csr") + starts.tocsr()
    found, before = csgraph.breadth_first_order(joined, root, directed=False)
    for vertex in found[1 + len(firsts) :]:
        if angle[vertex] > 0.0:
            axis = turns[vertex] / angle[vertex]
            whole = np.round((axis @ result[before[vertex]] - angle[vertex]) / (2.0 * np.pi))
            result[vertex] = (angle[vertex] + 2.0 * np.pi * whole) * axis
    return result
