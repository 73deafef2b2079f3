"""The contacts of poses of a surface that are to go: intersecting or close pairs, and folds."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.intersect.ignored import CountedPairs, counted_between
from dtrepair.intersect.proximity import close_pairs, face_each_other
from dtrepair.intersect.queries import Queries
from dtrepair.intersect.topology.ring_distances import MOST_RINGS, RingDistances
from dtrepair.numerics.attachments import Attachments
from dtrepair.numerics.geometry import FloatArray, IntArray, pair_keys
from dtrepair.numerics.work import uncounted
from dtrepair.repair.surface.uncertain_pairs import UncertainPairs

BoolArray = NDArray[np.bool_]


class Contacts:
    """Finds the contacts of poses of one surface, and decides which of them count.

    What it remembers from call to call - ring distances, exact verdicts, what is close at rest -
    never changes an answer, so that threads may share one object.

    Args:
        detector: Detector of the mesh, built on its rest.
        queries: Of the same detector.
        rest: Rest positions (V, 3), units of the size.
        size: Length of a unit.
        body_of: The body of each triangle (F,).
        fixed: Which vertices (V,) never move.
        rigid: Which vertices (V,) are of rigid bodies.
        mode: Which pairs count: "self", "inter" (between bodies) or "both".
        ignored: Pairs of bodies (i, j), i <= j, whose contacts do not count.
        leave_rest: Pairs and folds that the rest pose has as well do not count.
        neighbour_rings: Triangles at most so many edge rings apart need not keep a clearance.
        attachments: Contacts that were modelled do not count, nor folds in their zones.
    """

    def __init__(
        self,
        detector: Detector,
        queries: Queries,
        rest: FloatArray,
        size: float,
        *,
        body_of: NDArray[np.integer],
        fixed: BoolArray,
        rigid: BoolArray,
        mode: str = "both",
        ignored: tuple[tuple[int, int], ...] = (),
        leave_rest: bool = False,
        neighbour_rings: int = 6,
        most_rings: int = MOST_RINGS,
        attachments: Attachments | None = None,
    ) -> None:
        self._detector, self._queries, self._size = detector, queries, size
        self._rest = self._written(rest)
        self._body_of, self._mode, self._ignored = body_of, mode, ignored
        self._leave_rest, self._attachments = leave_rest, attachments
        self.neighbour_rings = neighbour_rings
        faces = detector.faces
        self._stiff = fixed | rigid
        # Triangles that never move, and those of rigid bodies; None where there are neither.
        self._still = np.asarray(fixed[faces].all(axis=1)) if self._stiff.any() else None
        self._whole = rigid[faces[:, 0]] if self._stiff.any() else None
        self._uncertain = UncertainPairs(detector, self._rest)
        self._close_at_rest: dict[float, NDArray[np.int64]] = {}
        self.ring_distance = RingDistances(detector.mesh, limit=most_rings)

    def pairs(self, points: FloatArray, *, active: BoolArray | None = None) -> IntArray:
        """Return the intersecting pairs (K, 2); with `active` (F,) those with an active triangle.

        Pairs that floating point cannot settle count as intersecting, but see `UncertainPairs`.
        """
        written = self._written(points)
        found = self._detector(written, exact=self._uncertain, active=active, zones=self._zones)
        return self._counted(found)

    def batch_pairs(self, points: FloatArray) -> IntArray:
        """Return the intersecting pairs (K, 3) of poses (B, V, 3): frame, triangle, triangle.

        Pairs that floating point cannot settle are settled exactly.
        """
        return self._counted(self._detector(self._written(points), zones=self._zones))

    def close_pairs(
        self, points: FloatArray, clearance: float, *, facing: bool = False
    ) -> IntArray:
        """Return the pairs (K, 2) closer than a clearance, units of the size, not neighbours.

        Neighbours are triangles at most `neighbour_rings` apart, the sides of a crease, and those
        as close in the rest pose; or, with `facing`, for a rest pose that has the contacts itself,
        those that do not face each other, as the sides of a limb. Intersecting pairs count as close
        whatever they are.
        """
        found = close_pairs(self._detector, self._written(points), clearance * self._size)
        if facing:
            found = found[face_each_other(points, self._detector.faces, found)]
        else:
            found = found[~np.isin(pair_keys(found), self._keys_close_at_rest(clearance))]
        found = found[self.ring_distance(found) > self.neighbour_rings]
        crossing = self._detector(self._written(points), exact=self._uncertain, zones=self._zones)
        return self._counted(_united(crossing, found))

    def folds(self, points: FloatArray, *, active: BoolArray | None = None) -> IntArray:
        """Return the folds (K, 2) that are to go; with `active` (V,) those around such vertices."""
        found = self._queries.folds(self._written(points), active=active)
        if self._leave_rest:
            found = found[~np.isin(pair_keys(found), self._folds_at_rest)]
        if self._attachments is not None:
            found = found[~self._attachments.triangles[found].all(axis=1)]
        if self._still is not None:
            corners = self._stiff[self._detector.faces[found]].reshape(-1, 6)
            found = found[~corners.all(axis=1)]
        return found

    def counts(self, pairs: IntArray) -> BoolArray:
        """Return which pairs, the triangles in the last two columns (K, 2 or 3), count."""
        keep = self._separable(pairs)
        if self._leave_rest:
            keep &= ~np.isin(pair_keys(pairs[:, -2:]), self._crossing_at_rest)
        if self._attachments is not None:
            keep &= ~self._attachments.modelled(pairs[:, -2:])
        return keep

    @cached_property
    def counted_pairs(self) -> CountedPairs:
        """What `counts` tells of pairs, for detection on a device."""
        none = np.zeros(len(self._body_of), dtype=bool)
        still = none if self._still is None else self._still
        whole = none if self._whole is None else self._whole
        kinds = np.stack([self._body_of, still, whole], axis=1).astype(np.int64)
        known, group = np.unique(kinds, axis=0, return_inverse=True)
        members = np.unique(group, return_index=True)[1]
        first, second = np.meshgrid(members, members, indexing="ij")
        both = np.stack([first.ravel(), second.ravel()], axis=1).astype(np.int32)
        counted = self._separable(both).reshape(len(known), len(known))
        listed = np.zeros((0, 2), dtype=np.int32)
        if self._leave_rest:
            listed = self._detector(self._rest)
        return CountedPairs(group.ravel().astype(np.int32), counted, listed)

    def _counted(self, pairs: IntArray) -> IntArray:
        return pairs[self.counts(pairs)]

    def _separable(self, pairs: IntArray) -> BoolArray:
        """Return which pairs can come apart: not two fixed triangles, nor two of one rigid body."""
        first, second, own = pairs[:, -2], pairs[:, -1], self._body_of
        keep = counted_between(own[pairs[:, -2:]], mode=self._mode, ignored=self._ignored)
        if self._still is not None and self._whole is not None:
            keep &= ~(self._still[first] & self._still[second])
            keep &= ~(self._whole[first] & (own[first] == own[second]))
        return keep

    @cached_property
    def _zones(self) -> Any:
        """Modelled contacts, for detection to leave out."""
        return self._detector.zones_of(self._attachments)

    def _written(self, points: FloatArray) -> NDArray[np.float32]:
        return (points * self._size).astype(np.float32)

    def _keys_close_at_rest(self, clearance: float) -> NDArray[np.int64]:
        near = 1.1 * clearance * self._size
        if near not in self._close_at_rest:
            found = close_pairs(self._detector, self._rest, near)
            self._close_at_rest[near] = pair_keys(found)
        return self._close_at_rest[near]

    @cached_property
    def _folds_at_rest(self) -> NDArray[np.int64]:
        return pair_keys(self._queries.folds(self._rest))

    @cached_property
    def _crossing_at_rest(self) -> NDArray[np.int64]:
        return pair_keys(uncounted(lambda: self._detector(self._rest)))


def _united(first: IntArray, second: IntArray) -> IntArray:
    """Return the pairs of two sets, each once, sorted."""
    keys = np.union1d(pair_keys(first), pair_keys(second))
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=1).astype(np.int32)
