"""Ties of garments to what they lie over: a sleeve follows its arm without touching it.

Where it is not held, an arm that is pushed out of the chest leaves its sleeve, and both are clean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.attachments import NO_TIES, Ties, distances, joined_ties, ties_to
from dtrepair.numerics.closest_point import NearestTriangles
from dtrepair.numerics.geometry import FloatArray, IntArray, diagonal
from dtrepair.numerics.worn.covering import Covering


@dataclass(frozen=True, kw_only=True)
class GarmentOptions:
    """Which vertices of garments are tied; lengths are fractions of the diagonal at rest.

    Args:
        near: Those that are no farther from what they lie over at rest: not the hem of a skirt.
        follows: And of which this distance changes by no more in half of the poses.
        most: Of the distances at rest so many per cent fit in between, see `room_between`.
    """

    near: float = 0.03
    follows: float = 0.02
    most: float = 90.0


def garment_ties(
    covering: Covering | None,
    faces: IntArray,
    poses: Sequence[FloatArray],
    *,
    options: GarmentOptions = GarmentOptions(),
) -> Ties:
    """Return ties of the vertices of open layers to the parts that they lie over.

    Args:
        covering: What lies over what, numbered as the vertices of the poses; None: nothing does.
        faces: Triangles (F, 3), whose vertices at one position of the rest are one.
        poses: Poses (V, 3), the first at rest; those of a whole clip tell what follows what. Where
            they are of the rest only, all that is near counts.
        options: Which vertices are tied.
    """
    if covering is None:
        return NO_TIES
    rest, part_of_face = poses[0], covering.part[faces[:, 0]]
    used = np.zeros(len(rest), dtype=bool)
    used[faces] = True
    own = np.flatnonzero(used & (covering.beneath >= 0))
    under = covering.part[covering.beneath[own]]
    found = [NO_TIES]
    for part in np.unique(under).tolist():
        triangles = np.flatnonzero(part_of_face == part)
        nearest = NearestTriangles(rest[faces[triangles]])
        found.append(ties_to(nearest, triangles, rest, own[under == part]))
    ties, unit = joined_ties(found), diagonal(rest)
    away = distances(ties, rest, faces)
    kept = away <= options.near * unit
    if len(poses) > 1:
        changes = [np.abs(distances(ties, pose, faces) - away) for pose in poses[1:]]
        kept &= np.median(changes, axis=0) <= options.follows * unit
    return ties.among(kept)


def room_between(
    ties: Ties,
    rest: FloatArray,
    faces: IntArray,
    layers: int,
    *,
    options: GarmentOptions = GarmentOptions(),
) -> float:
    """Return how far apart limbs have to be for their garments to fit in between, length units.

    Args:
        ties: The ties of the garments.
        rest, faces: The pose (V, 3) and the triangles (F, 3) that they are of.
        layers: How many lie over each other at most.
        options: Which distances count.
    """
    if len(ties.vertices) == 0:
        return 0.0
    return layers * float(np.percentile(distances(ties, rest, faces), options.most))
