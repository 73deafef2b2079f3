"""Preferred directions in the full method: regions stay on their line, alone and against others."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Repairer, RepairOptions, Status
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.surface.surface import Surface
from tests.meshes import armed_body, icosphere, overlapping_spheres

POINTS, FACES = icosphere(2)
OTHER = overlapping_spheres()[0][len(POINTS) :]
X, Y, Z = np.eye(3)


def directed(way: FloatArray, region: slice | None = None) -> Steering:
    """A sphere with a direction, everywhere or in a region."""
    direction = np.zeros_like(POINTS)
    direction[region or slice(None)] = way
    return Steering(Surface(POINTS, FACES, direction=direction))


def test_what_goes_along_is_not_astray_and_what_goes_back_is() -> None:
    steering = directed(3.0 * Y)
    still = np.zeros_like(POINTS)
    assert steering.astray(still) == 0.0
    assert steering.astray(still + Y) == pytest.approx(0.0)
    assert steering.astray(still - Y) == pytest.approx(1.0)
    assert steering.astray(still + X) == pytest.approx(1.0)
    assert steering.astray(still + Y + X) == pytest.approx(0.5**0.5)


def test_a_surface_without_directions_has_no_regions() -> None:
    steering = Steering(Surface(POINTS, FACES))
    assert not steering and steering.astray(POINTS) == 0.0
    assert steering.steered(POINTS) is POINTS


def test_a_region_keeps_its_line_and_its_shape_is_free() -> None:
    steering = directed(Y)
    assert len(steering.regions) == 1
    bent = 0.1 * np.sin(5.0 * POINTS)
    motion = steering.steered(bent + X + 2.0 * Y)
    assert motion.mean(axis=0) == pytest.approx([0.0, 2.0, 0.0] + bent.mean(axis=0) * Y)
    assert np.abs(motion - motion.mean(axis=0) - (bent - bent.mean(axis=0))).max() < 1e-12
    assert np.array_equal(directed(Y, slice(0, 0)).steered(bent), bent)


def moved_as_wholes(*ways: FloatArray) -> list[FloatArray]:
    """How two spheres that overlap along x are moved, the last ones of them with a direction."""
    given = [None] * (2 - len(ways)) + [np.tile(way, (len(POINTS), 1)) for way in ways]
    poses = [POINTS, OTHER]
    bodies = [Body(p, FACES, direction=way) for p, way in zip(poses, given, strict=True)]
    results = SceneRepairer(bodies)(poses)
    assert all(result.status is Status.CLEAN for result in results)
    moved = [result.points - pose for result, pose in zip(results, poses, strict=True)]
    return [motion.mean(axis=0) for motion in moved]


@pytest.mark.parametrize("ways", [(Y,), (Y, Z), (-X, Y)], ids=str)
def test_every_directed_body_goes_its_own_way(ways: tuple[FloatArray, ...]) -> None:
    # Left alone they part along x; steered by the published method they stray by .6 of the way.
    for motion, way in zip(moved_as_wholes(*ways)[-len(ways) :], ways, strict=True):
        along = float(motion @ way)
        assert along > 0.1
        assert np.linalg.norm(motion - along * way) < 0.3 * along


@pytest.mark.parametrize("way", [Y, -Z], ids=str)
def test_a_region_of_a_mesh_is_led_its_way_and_not_far_beyond_it(way: FloatArray) -> None:
    rest, faces = armed_body(0.0)
    pose = armed_body(4.2)[0]
    arm = np.arange(len(pose)) > 12 * 30
    direction = np.where(arm[:, None], way, 0.0)
    motions = []
    for method in ("full", "paper"):
        options = RepairOptions(method=method)
        result = Repairer(rest, faces, options=options, direction=direction)(pose)
        assert result.status is Status.CLEAN
        motions.append((result.points - pose)[arm].mean(axis=0))
    along = [float(motion @ way) for motion in motions]
    off = [np.linalg.norm(m - a * way) for m, a in zip(motions, along, strict=True)]
    assert along[0] > 0.1
    # At least as straight as the published method, give or take a fiftieth of the way.
    assert off[0] / along[0] < off[1] / along[1] + 0.02


def test_a_direction_that_would_strain_the_shape_is_left() -> None:
    rest, faces = armed_body(0.0)
    pose = armed_body(4.2)[0]
    direction = np.where((np.arange(len(pose)) > 12 * 30)[:, None], -X, 0.0)
    repairer = Repairer(rest, faces, direction=direction)
    assert repairer(pose).status is Status.CLEAN
