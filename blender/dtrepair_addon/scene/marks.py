"""Intersecting polygons as a face attribute and a vertex group, and as contacts to go to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..host.exchange import SampledMesh

# Blender takes a vertex group for an attribute as well, so that both need names of their own.
FACES, GROUP = "dtrepair_faces", "dtrepair_vertices"


@dataclass(frozen=True)
class Contact:
    """Where two meshes, or one and itself, intersect in a frame; in world space."""

    frame: int
    first: int
    second: int
    pairs: int
    centre: tuple[float, float, float]
    size: float


def mark(target: Any, polygons: NDArray[np.integer]) -> None:
    """Mark polygons (K,) in a face attribute, and their vertices in a vertex group."""
    mesh = target.data
    clear(target)
    mask = np.zeros(len(mesh.polygons), dtype=bool)
    mask[polygons] = True
    mesh.attributes.new(FACES, "BOOLEAN", "FACE").data.foreach_set("value", mask)
    group = target.vertex_groups.new(name=GROUP)
    vertices = {v for polygon in polygons.tolist() for v in mesh.polygons[polygon].vertices}
    group.add(sorted(vertices), 1.0, "REPLACE")


def clear(target: Any) -> None:
    """Take the marks of an object away."""
    if (attribute := target.data.attributes.get(FACES)) is not None:
        target.data.attributes.remove(attribute)
    if (group := target.vertex_groups.get(GROUP)) is not None:
        target.vertex_groups.remove(group)


def polygons_of(pairs: NDArray[np.integer], mesh: int) -> NDArray[np.integer]:
    """Return the polygons of a mesh in pairs (K, 4) of mesh, polygon, mesh, polygon."""
    sides = pairs.reshape(-1, 2)
    return np.unique(sides[sides[:, 0] == mesh, 1])


def contacts(
    meshes: Sequence[SampledMesh], frames: Sequence[int], found: Sequence[NDArray[np.integer]]
) -> list[Contact]:
    """Return the contacts of all frames, those with most pairs first within a frame."""
    contacts = []
    for index, frame in enumerate(frames):
        sides = np.sort(found[index][:, [0, 2]], axis=1)
        which, numbers = np.unique(sides, axis=0, return_counts=True)
        for place in np.argsort(-numbers, kind="stable"):
            first, second = which[place].tolist()
            own = found[index][(sides == which[place]).all(axis=1)]
            corners = np.concatenate([_corners(m, i, index, own) for i, m in enumerate(meshes)])
            low, high = corners.min(axis=0), corners.max(axis=0)
            centre = tuple((0.5 * (low + high)).tolist())
            size = float(np.linalg.norm(high - low))
            contacts.append(Contact(frame, first, second, int(numbers[place]), centre, size))
    return contacts


def _corners(
    mesh: SampledMesh, number: int, index: int, pairs: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Return the world positions (N, 3) of the corners of a mesh's polygons in pairs."""
    triangles = triangles_of(mesh, polygons_of(pairs, number))
    return world(mesh, index)[np.unique(triangles)]


def world(mesh: SampledMesh, index: int) -> NDArray[np.float64]:
    """Return the points (V, 3) of a mesh in world space at a frame by its index."""
    matrix = mesh.matrices[index]
    return np.asarray(mesh.points[index] @ matrix[:3, :3].T + matrix[:3, 3])


def triangles_of(mesh: SampledMesh, polygons: NDArray[np.integer]) -> NDArray[np.int32]:
    """Return the triangles (F, 3) of polygons, as fans from their first corner."""
    starts = np.concatenate([[0], np.cumsum(mesh.counts)])
    fans = [
        (mesh.corners[starts[p]], *mesh.corners[starts[p] + k : starts[p] + k + 2])
        for p in polygons.tolist()
        for k in range(1, int(mesh.counts[p]) - 1)
    ]
    return np.array(fans, dtype=np.int32).reshape(-1, 3)
