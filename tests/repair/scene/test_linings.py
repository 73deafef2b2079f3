"""Linings are turned round for a repair, unless they are sewn to what they line."""

from __future__ import annotations

import numpy as np

from dtrepair import Body, RepairOptions
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from tests.meshes import icosphere, tube

SHIRT, LINING, COAT = (tube(24, 12, radius, 1.0) for radius in (0.23, 0.25, 0.27))


def scene(*, sewn: bool = False, method: str = "full") -> Scene:
    """A body in a shirt in a coat with a lining, whose hems are those of the coat if it is sewn."""
    points, faces = icosphere(4)
    lining = LINING[0].copy()
    if sewn:
        hems = np.abs(lining[:, 2]) > 0.49
        lining[hems] = COAT[0][hems]
    meshes = [(points * [0.2, 0.2, 2.0], faces), SHIRT, (lining, LINING[1][:, [0, 2, 1]]), COAT]
    return make_scene([Body(*mesh) for mesh in meshes], RepairOptions(method=method))


def is_turned(of: Scene) -> list[bool]:
    """Which bodies have other triangles than were given."""
    starts = zip(of.triangle_starts, of.triangle_starts[1:], of.vertex_starts, strict=False)
    own = [of.faces[a:b] - start for a, b, start in starts]
    pairs = zip(own, of.bodies, strict=True)
    return [not np.array_equal(faces, np.asarray(body.faces)) for faces, body in pairs]


def test_a_lining_is_turned_round_and_nothing_else() -> None:
    found = scene()
    assert is_turned(found) == [False, False, True, False]
    own = found.faces[found.triangle_starts[2] : found.triangle_starts[3]]
    assert np.array_equal(own - found.vertex_starts[2], LINING[1])


def test_one_that_is_sewn_to_its_coat_goes_on_in_it() -> None:
    found = scene(sewn=True)
    assert not any(is_turned(found))


def test_the_published_method_takes_triangles_as_they_are() -> None:
    assert not any(is_turned(scene(method="paper")))
