"""Parts of a mesh that overlap stay two where they touch; what is sewn there, or rests, is one."""

from __future__ import annotations

import numpy as np

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.touches import without_touches
from dtrepair.numerics.geometry import FloatArray, IntArray, components, weld_map
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.make_scene import make_scene
from tests.meshes import Mesh, icosphere, joined

BALL = icosphere(2, 1.0)


def touching(apart: float) -> Mesh:
    """Two balls, one as far from the other as two of its vertices are, which come to one place."""
    points, faces = BALL
    far = np.linalg.norm(points - points[0], axis=1)
    at = int(np.abs(far - apart).argmin())
    other = points + (points[0] - points[at])
    other[at] = points[0]
    return joined((points, faces), (other, faces))


def count(faces: IntArray, weld: IntArray) -> int:
    """How many parts there are."""
    return len(np.unique(components(weld[faces], len(weld))[weld[faces]]))


def parted(points: FloatArray, faces: IntArray) -> tuple[int, int]:
    """How many parts there are with everything at one place welded, and without touches."""
    weld = weld_map(points)
    found = without_touches(faces, weld, lambda: Detector(points, faces)(points, weld=weld))
    assert np.array_equal(points[found], points)
    return count(faces, weld), count(faces, found)


def test_what_overlaps_and_touches_in_a_point_is_two() -> None:
    assert parted(*touching(0.6)) == (1, 2)


def test_what_only_touches_is_one() -> None:
    assert parted(*touching(2.0)) == (1, 1)


def test_what_overlaps_and_touches_along_a_line_is_two() -> None:
    """Two wedges share an edge, and one lies in half of the other: no seam, for both are closed."""
    edge = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    sides = np.array([[0, 1, 2], [1, 0, 3], [2, 3, 0], [3, 2, 1]], dtype=np.int32)
    wedges = [
        (np.array([*edge, [1.0, low, 0.5], [1.0, high, 0.4]]), sides)
        for low, high in ((-0.4, 0.4), (0.0, 0.8))
    ]
    assert parted(*joined(*wedges)) == (1, 2)


def test_a_skin_that_is_cut_along_seams_is_one_and_nobody_asks_what_overlaps() -> None:
    points, faces = BALL
    apart = points[faces].reshape(-1, 3)
    single = np.arange(len(apart), dtype=np.int32).reshape(-1, 3)
    weld = weld_map(apart)

    def asked() -> IntArray:
        raise AssertionError("nothing touches")

    assert without_touches(single, weld, asked) is weld


def test_the_rest_of_a_scene_knows_them_as_two() -> None:
    points, faces = touching(0.6)
    scene = make_scene([Body(points, faces)], RepairOptions())
    assert scene.enclosures.count == 2
    # Nor is the point that they touch in a seam.
    assert np.array_equal(scene.rest_sewn, scene.rest_weld)
    assert make_scene([Body(*touching(2.0))], RepairOptions()).enclosures.count == 1
