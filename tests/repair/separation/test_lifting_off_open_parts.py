"""What a layer is lifted off may be open: a body that ends at its neck, a stub, an empty sleeve."""

from __future__ import annotations

import numpy as np

from dtrepair.intersect.detector import Detector
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.scene.make_scene import make_scene
from tests.meshes import tube
from tests.repair.separation.test_lifting import lifted, radius


def test_a_limb_that_leans_on_a_sleeve_is_not_what_the_sleeve_went_under() -> None:
    (arm, faces), (sleeve, of_sleeve) = tube(24, 60, 0.2, 6.0), tube(24, 24, 0.23, 2.0)
    arm[:, 2] += 3.0  # the sleeve is half empty, as where a body ends under its shirt
    scene = make_scene([Body(arm, faces), Body(sleeve, of_sleeve)], RepairOptions())
    x, y, z = arm.T
    # Folded by half a turn, its far half reaches from outside into the empty half of the sleeve.
    far = np.clip(z - 1.2, 0.0, 1.0)[:, None]
    back = np.stack([0.36 - x, y, 3.2 - z], axis=1)
    pose = np.concatenate([(1.0 - far) * arm + far * back, sleeve])
    assert len(Detector(pose, scene.faces)(pose))
    moved = np.linalg.norm(lifted(scene, pose)[0] - pose, axis=1)[len(arm) :]
    assert moved[sleeve[:, 2] < -0.3].max() < 0.02


def test_what_is_far_behind_an_open_part_is_not_under_it() -> None:
    stub, sleeve = tube(24, 12, 0.2, 1.0), tube(24, 40, 0.23, 4.0)
    scene = make_scene([Body(*stub), Body(*sleeve)], RepairOptions())
    turn = np.radians(20.0)
    turned = stub[0] @ [
        [np.cos(turn), 0, -np.sin(turn)],
        [0, 1, 0],
        [np.sin(turn), 0, np.cos(turn)],
    ]
    pose = np.concatenate([turned, sleeve[0]])
    moved = np.linalg.norm(lifted(scene, pose)[0] - pose, axis=1)[len(turned) :]
    assert moved.max() > 0.05  # the rims of the stub came through
    assert moved[np.abs(sleeve[0][:, 2]) > 1.5].max() < 0.02


def test_a_sleeve_is_lifted_off_the_thin_arm_of_a_wide_open_body() -> None:
    points, faces = tube(24, 160, 1.0, 8.0)
    # A belly of radius 2 that ends in an arm of radius .05, open at both ends.
    wide = np.clip((-1.5 - points[:, 2:]) / 0.5, 0.0, 1.0)
    body = points * np.hstack([np.tile(0.05 + 1.95 * wide, 2), np.ones_like(wide)])
    sleeve = tube(24, 24, 0.058, 1.0)
    scene = make_scene([Body(body, faces), Body(*sleeve)], RepairOptions())
    thick = 1.0 + 0.4 * np.exp(-((body[:, 2:] / 0.2) ** 2)) * (wide == 0.0)
    pose = np.concatenate([body * np.hstack([thick, thick, np.ones_like(thick)]), sleeve[0]])
    layer = lifted(scene, pose)[0][len(body) :]
    middle, ends = np.abs(layer[:, 2]) < 0.05, np.abs(layer[:, 2]) > 0.45
    assert (radius(layer)[middle] > 0.05 * 1.35).all() and (radius(layer)[ends] < 0.06).all()
