"""A limb in a sleeve with a thickness, which is sewn to it at one end: a thin closed shell."""

from __future__ import annotations

import numpy as np

from dtrepair.intersect.detector import find_intersections
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.scene.bodies import Body
from tests.meshes import Mesh, elbow

ALONG, AROUND = 40, 24
FIRST, LAST, SEWN = 14, 38, 3  # rings of the limb, and so many of them that are sewn on
THICK = 0.01


def limb(bend: float) -> Mesh:
    """A closed limb of radius 0.2, bent over its middle."""
    return elbow(bend, ALONG, AROUND)


def sleeve(bend: float, radius: float = 0.24, thick: float = THICK, sewn: float = 0.196) -> Mesh:
    """A closed shell over the upper part of a limb; its last rings have the inner radius `sewn`."""
    outer, faces = _side(bend, radius + thick, sewn + thick)
    inner, _ = _side(bend, radius, sewn)
    ring, ahead, count = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND, len(outer)
    last = ring + count - AROUND
    beyond = ahead + count - AROUND
    rims = [
        [ring, ahead + count, ahead],
        [ring, ring + count, ahead + count],
        [last, beyond, beyond + count],
        [last, beyond + count, last + count],
    ]
    strips = [np.stack(corners, axis=1) for corners in rims]
    every = np.concatenate([faces, faces[:, ::-1] + count, *strips]).astype(np.int32)
    return np.concatenate([outer, inner]), every


def _side(bend: float, radius: float, sewn: float) -> Mesh:
    """One side of the sleeve, an open tube."""
    points, faces = elbow(bend, ALONG, AROUND, radius)
    narrow, _ = elbow(bend, ALONG, AROUND, sewn)
    first, last = FIRST * AROUND, LAST * AROUND
    points[last - SEWN * AROUND : last] = narrow[last - SEWN * AROUND : last]
    kept = ((faces >= first) & (faces < last)).all(axis=1)
    return points[first:last], (faces[kept] - first).astype(np.int32)


def shelled_limb(**shape: float) -> tuple[list[Body], Reference]:
    """The sleeve and the limb at rest, and what the rest shows; shape: of the sleeve."""
    cloth, arm = sleeve(0.0, **shape), limb(0.0)
    rest = np.concatenate([cloth[0], arm[0]])
    faces = np.concatenate([cloth[1], arm[1] + len(cloth[0])])
    shown = Reference(rest, find_intersections(rest, faces).astype(np.int32))
    return [Body(*cloth, name="sleeve"), Body(*arm, name="limb")], shown


def bent_through(bend: float, followed: float = 0.3) -> list[FloatArray]:
    """The sleeve and the limb in a pose in which the limb bends out through the sleeve."""
    return [sleeve(followed)[0], limb(bend)[0]]
