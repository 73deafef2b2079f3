"""Who is led out of something takes along what is worn."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.worn.measure import WornOptions
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.penetration import BodyShape
from dtrepair.repair.separation.worn_pairs import WornPairs
from tests.meshes import Mesh, icosphere, torus
from tests.repair.separation.test_separation import separated

# A rod-like body, a band round it (closed) or a sleeve over it (open), and a ball beside it.
BODY = icosphere(3)[0] * (0.3, 0.3, 1.5), icosphere(3)[1]
BALL = icosphere(2, 0.5)
BAND = torus(32, 8, 0.36, 0.03)
ASIDE = np.array([5.0, 0.0, 0.0])


def sleeve(*, least: float = -1.0) -> Mesh:
    """Some rings of the body, a little larger and open; or what of them is beyond y, as a cape."""
    points, faces = BODY
    kept = ((np.abs(points[faces][:, :, 2]) < 0.5) & (points[faces][:, :, 1] > least)).all(axis=1)
    used, own = np.unique(faces[kept], return_inverse=True)
    return points[used] * (1.15, 1.15, 1.0), own.reshape(-1, 3).astype(np.int32)


def scene_of(worn: Mesh, *, free: float = 1.0, still: float = 0.0) -> Scene:
    ball = Body(BALL[0] + ASIDE, BALL[1], mobility=still, rigid=still > 0.0)
    return make_scene([Body(*BODY), Body(*worn, mobility=free), ball], RepairOptions())


def companions(scene: Scene, body: int, other: int) -> tuple[int, ...]:
    shapes = {own: BodyShape(scene, own) for own in range(3)}
    return WornPairs(scene, shapes.__getitem__, WornOptions()).companions(body, other)


@pytest.mark.parametrize(
    "worn", [BAND, sleeve(), sleeve(least=0.05)], ids=["band", "sleeve", "cape"]
)
def test_a_body_and_what_it_wears_go_together(worn: Mesh) -> None:
    scene = scene_of(worn, still=1.0)
    assert companions(scene, 0, 2) == companions(scene, 1, 2) == (0, 1)
    assert companions(scene, 2, 0) == (2,)
    # Of each other they are led off one by one.
    assert companions(scene, 0, 1) == (0,) and companions(scene, 1, 0) == (1,)
    # Where something of it is held, or gives way slowly, it is pushed instead.
    assert companions(scene_of(worn, free=0.0), 0, 2) == (0,)
    assert companions(scene_of(worn, free=0.5), 0, 2) == (0,)


@pytest.mark.parametrize("worn", [BAND, sleeve()], ids=["band", "sleeve"])
def test_a_band_goes_along_with_the_body_that_is_led_out_of_a_ball(worn: Mesh) -> None:
    scene = scene_of(worn)
    end = np.array([0.2, 0.0, 1.2])
    pose = [BODY[0], worn[0], BALL[0] + end]
    moved: FloatArray = separated(scene, pose, sheets=(0, 1, 2))[0] - np.concatenate(pose)
    far = np.linalg.norm(moved, axis=1)
    body, band = (far[scene.vertices_of(own)] for own in (0, 1))
    assert body.min() > 0.2 and np.allclose(moved[scene.vertices_of(1)], moved[0])
    assert np.allclose(band, body[0]) and not far[scene.vertices_of(2)].any()
