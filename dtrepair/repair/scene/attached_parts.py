"""What the connected parts of a scene have to do with each other by their attachments."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.attached.attachment_options import AttachmentOptions
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attached.riders import with_riders
from dtrepair.numerics.attachments import Attachments, Reference
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.surface.containment import Enclosures


def known_attachments(
    faces: IntArray, references: Sequence[Reference], poses: Sequence[FloatArray]
) -> Attachments | None:
    """Return what references show as attached, and what rides on it; None where nothing is.

    faces: triangles (F, 3), whose vertices at one position of the rest are one; poses: the rest
    (V, 3), and poses of the whole clip.
    """
    found = find_attachments(faces, len(poses[0]), references, poses=poses)
    if len(found.zones) + len(found.every_tie.vertices) == 0:
        return None
    return with_riders(found, faces, poses)


class AttachedParts:
    """Attachments of parts by the numbers that they have in a scene.

    Args:
        attachments: What was modelled; None where nothing was.
        faces: Triangles (F, 3), whose vertices at one position of the rest are one.
        part: The part (V,) of each vertex, -1 for those without a triangle.
        options: What is attached as a whole.
    """

    def __init__(
        self,
        attachments: Attachments | None,
        faces: IntArray,
        part: IntArray,
        *,
        options: AttachmentOptions = AttachmentOptions(),
    ) -> None:
        self._whole = options.whole
        self._known, self._faces, self._part = attachments, faces, part
        self._part_of_face = part[faces[:, 0]]
        self._pairs: set[tuple[int, int]] = set()
        if attachments is not None:
            self._name = np.zeros(int(part.max(initial=-1)) + 1, dtype=np.int64)
            self._name[self._part_of_face] = attachments.part_of
            self._pairs = set(attachments.pairs_of_parts)

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """The pairs of parts that are attached."""
        if not self._pairs:
            return []
        used = np.unique(self._part_of_face).tolist()
        number = dict(zip(self._name[used].tolist(), used, strict=True))
        there = [both for both in sorted(self._pairs) if number.keys() >= set(both)]
        return [(number[first], number[second]) for first, second in there]

    def attached(self, parts: IntArray) -> NDArray[np.bool_]:
        """Return which two parts of (K, 2) are attached to each other, (K,)."""
        if not self._pairs:
            return np.zeros(len(parts), dtype=bool)
        names = self._name[parts].tolist()
        return np.array([tuple(sorted(both)) in self._pairs for both in names], dtype=bool)

    def meant_inside(
        self, parts: IntArray, points: FloatArray, enclosures: Enclosures
    ) -> NDArray[np.bool_]:
        """Return which first parts of (K, 2) may be inside the second one in a pose (V, 3).

        They are attached, and either slide in each other, or most of the first was behind the
        second in the bind pose, as an eye is, or it still comes out: a pouch that sat on a hip may
        not end wholly in it.
        """
        meant = self.attached(parts)
        if not meant.any():
            return meant
        for k in np.flatnonzero(meant & ~self._sliding(parts)):
            inner, outer = parts[k].tolist()
            if self._tied(inner, outer) < self._whole * self._sizes[inner]:
                meant[k] = not enclosures.wholly_inside(points, inner, outer)
        return meant

    def _sliding(self, parts: IntArray) -> NDArray[np.bool_]:
        """Return which two parts of (K, 2) slide in each other, as a rod in its cylinder."""
        assert self._known is not None
        names = self._name[parts].tolist()
        return np.array([tuple(sorted(both)) in self._known.sliding for both in names], dtype=bool)

    def _tied(self, inner: int, outer: int) -> int:
        """Return how many vertices of a part are tied to another one."""
        vertices, hosts = self._ties
        return len(np.unique(vertices[(hosts == outer) & (self._part[vertices] == inner)]))

    def unmodelled(self, pairs: IntArray) -> IntArray:
        """Return those of the pairs (K, 2) of triangles that are no modelled contacts."""
        return pairs if self._known is None else pairs[~self._known.modelled(pairs)]

    def zone(self, part: int, other: int) -> IntArray | None:
        """Return the vertices (N,) of a part in its zone towards another one, ascending.

        None where the two are not attached to each other.
        """
        if self._known is None or not self.attached(np.array([[part, other]]))[0]:
            return None
        keys, triangles = self._zones
        own = part * self._known.count + self._name[other]
        start, end = np.searchsorted(keys, [own, own + 1])
        return np.unique(self._faces[triangles[start:end]]).astype(np.int32)

    def wholes_on(self, part: int) -> list[int]:
        """Return the smaller parts that are attached to a part as wholes: buttons on a coat."""
        vertices, hosts = self._ties
        tied = np.bincount(
            self._part[np.unique(vertices[hosts == part])], minlength=len(self._sizes)
        )
        whole = (tied == self._sizes) & (self._sizes < self._sizes[part])
        return [int(rider) for rider in np.flatnonzero(whole & (tied > 0))]

    def held(self, part: int) -> IntArray:
        """Return the vertices (N,) of a part in its zones, but towards what is on it whole."""
        if self._known is None:
            return np.zeros(0, dtype=np.int32)
        triangles, towards = np.divmod(self._known.zones, self._known.count)
        free = self._name[self.wholes_on(part)]
        own = (self._part_of_face[triangles] == part) & ~np.isin(towards, free)
        return np.unique(self._faces[triangles[own]]).astype(np.int32)

    @cached_property
    def _zones(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Triangles (N,) of zones, by sorted keys (N,): own part, and what the zone is towards."""
        assert self._known is not None
        triangles, towards = np.divmod(self._known.zones, self._known.count)
        keys = self._part_of_face[triangles].astype(np.int64) * self._known.count + towards
        order = np.argsort(keys, kind="stable")
        return keys[order], triangles[order]

    @cached_property
    def _sizes(self) -> IntArray:
        """How many vertices each part has."""
        return np.bincount(self._part[self._part >= 0]).astype(np.int32)

    @cached_property
    def _ties(self) -> tuple[IntArray, IntArray]:
        """The vertex (N,) of each tie, and the part (N,) that holds it."""
        if self._known is None:
            return np.zeros(0, np.int32), np.zeros(0, np.int32)
        return self._known.ties.vertices, self._part_of_face[self._known.ties.triangles]


def attached_bodies(
    known: Attachments | None, body_of: NDArray[np.integer], body_of_vertex: NDArray[np.integer]
) -> set[int]:
    """Return the bodies that hold on to others; the body of each triangle (F,), vertex (V,)."""
    if known is None:
        return set()
    body_of_part = np.zeros(known.count, dtype=np.int64)
    body_of_part[known.part_of] = body_of
    ties = known.every_tie
    pairs = [
        body_of_part[np.array(known.pairs_of_parts, dtype=np.int64).reshape(-1, 2)],
        np.stack([body_of_vertex[ties.vertices], body_of[ties.triangles]], axis=1),
    ]
    bodies = np.concatenate(pairs)
    return set(np.unique(bodies[bodies[:, 0] != bodies[:, 1]]).tolist())
