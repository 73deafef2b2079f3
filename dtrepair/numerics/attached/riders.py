"""Small parts that ride on a larger one without touching it: teeth in a mouth, hair over a scalp.

Nothing of them overlaps at rest, so that no attachment is known. Where they are not carried along,
what they ride on moves through them, and they are pushed out of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.attachments import (
    NO_TIES,
    Attachments,
    Ties,
    distances,
    joined_ties,
    ties_to,
)
from dtrepair.numerics.closest_point import NearestTriangles
from dtrepair.numerics.enclosure import enclosure
from dtrepair.numerics.geometry import FloatArray, IntArray, triangle_areas


@dataclass(frozen=True, kw_only=True)
class RiderOptions:
    """What counts as riding on a larger part.

    Args:
        larger: The other part has so many times the area.
        near: At rest the other part is within this fraction of the small one's size, the root of
            its area, at half of the vertices that are tied; or it encloses ...
        enclosed: ... all of them, with at least this winding number, as a head does its teeth.
        cells: Along the extent of what may enclose.
        follows: In no pose does this distance change by more than this fraction of the size ...
        share: ... at this share of the vertices at least: the others are not tied.
        hosts: So many parts, the largest, are asked what rides on them.
    """

    larger: float = 10.0
    near: float = 0.3
    enclosed: float = 0.75
    cells: int = 32
    follows: float = 0.1
    share: float = 0.5
    hosts: int = 8


def with_riders(
    attachments: Attachments, faces: IntArray, poses: Sequence[FloatArray]
) -> Attachments:
    """Return the same with small parts carried along that nothing holds so far; see `riders`.

    By parts that are attached to others: loose things stay as they are. One pose tells nothing.
    """
    if len(poses) < 2:
        return attachments
    part_of = attachments.part_of
    part_of_vertex = np.zeros(len(poses[0]), dtype=np.int32)
    part_of_vertex[faces] = part_of[:, None]
    hosts = np.zeros(attachments.count, dtype=bool)
    hosts[np.array(attachments.pairs_of_parts, dtype=np.int64).ravel()] = True
    free = ~hosts
    free[part_of_vertex[attachments.carried.vertices]] = False
    return attachments.carrying(riders(poses, faces, part_of, free, hosts))


def riders(
    poses: Sequence[FloatArray],
    faces: IntArray,
    part_of: IntArray,
    free: NDArray[np.bool_],
    hosts: NDArray[np.bool_],
    *,
    options: RiderOptions = RiderOptions(),
) -> Ties:
    """Tie small parts to what they ride on in all poses.

    Args:
        poses: Poses (V, 3), the first at rest; those of a whole clip tell what follows what.
        faces: Triangles (F, 3), whose vertices at one position of the rest are one.
        part_of: The connected part (F,) of each triangle.
        free: Which parts (P,) nothing holds so far.
        hosts: Which parts (P,) others may ride on.
    """
    rest, count = poses[0], len(free)
    areas = np.bincount(part_of, triangle_areas(rest, faces), count)
    part_of_vertex = np.full(len(rest), -1, dtype=np.int32)
    part_of_vertex[faces] = part_of[:, None]
    own = np.flatnonzero(np.append(free, False)[part_of_vertex])
    # The size of a strip is not its length.
    size = np.sqrt(areas)
    found = [NO_TIES]
    largest = np.argsort(-np.where(hosts, areas, -1.0), kind="stable")
    for host in largest[: min(options.hosts, np.count_nonzero(hosts))].tolist():
        triangles = np.flatnonzero(part_of == host)
        corners = rest[faces[triangles]]
        small = free & (options.larger * areas < areas[host])
        reach = options.near * size[small].max(initial=0.0)
        beside = own[_in_box(rest[own], corners, reach)]
        small &= np.isin(np.arange(count), part_of_vertex[beside])
        asked = own[small[part_of_vertex[own]]]
        if len(asked) == 0:
            continue
        feet = ties_to(NearestTriangles(corners), triangles, rest, asked)
        within = np.abs(enclosure(rest[asked], corners, options.cells)) >= options.enclosed
        tied, riding = _riding(poses, faces, feet, part_of_vertex[asked], size, within, options)
        found.append(feet.among(tied))
        free = free & ~riding
        own = own[free[part_of_vertex[own]]]
    return joined_ties(found)


def _in_box(points: FloatArray, corners: FloatArray, reach: float) -> NDArray[np.bool_]:
    """Return which points (N, 3) are in the box of triangles (F, 3, 3), or as near as `reach`."""
    low, high = corners.min(axis=(0, 1)) - reach, corners.max(axis=(0, 1)) + reach
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _riding(
    poses: Sequence[FloatArray],
    faces: IntArray,
    feet: Ties,
    part: IntArray,
    size: FloatArray,
    within: NDArray[np.bool_],
    options: RiderOptions,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which vertices (N,) of the parts (N,) are tied, and which parts (P,) ride.

    within: which vertices (N,) the other part encloses at rest.
    """
    away = distances(feet, poses[0], faces)
    off = [np.abs(distances(feet, pose, faces) - away) for pose in poses[1:]]
    follows = np.max(off, axis=0, initial=0.0) <= options.follows * size[part]
    every, count = np.bincount(part, minlength=len(size)), len(size)
    near = np.bincount(part[follows & (away <= options.near * size[part])], minlength=count)
    kept = np.bincount(part[follows], minlength=count)
    inside = np.bincount(part[within], minlength=count) == every
    riding = (kept > options.share * every) & ((2 * near >= kept) | inside) & (kept > 0)
    return follows & riding[part], riding
