"""Parts with a little too little volume swell, where nothing is near."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import volume
from dtrepair.repair.relief.swelling import with_volume
from dtrepair.repair.scene.bounds import strain_of
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.scene import Scene
from tests.meshes import icosphere, swept

BALL, FACES = icosphere(3)
BESIDE = np.array([2.05, 0.0, 0.0])
WALL = BALL * [0.05, 1.0, 1.0] + [0.95, 0.0, 0.0]


def scene_of(
    other: FloatArray, pin: FloatArray | None = None, limit: float | None = None
) -> tuple[Scene, OpenedPose]:
    """A ball and another body, in their rests."""
    options = RepairOptions(maximum_displacement=limit)
    scene = make_scene([Body(BALL, FACES, pin=pin), Body(other, FACES)], options)
    return scene, detected(scene, gathered(scene, [BALL, other]))


def shrunk(pose: OpenedPose, scale: float) -> FloatArray:
    """The pose with the ball scaled about its centre."""
    points = pose.centred.copy()
    own = points[: len(BALL)]
    points[: len(BALL)] = own.mean(axis=0) + scale * (own - own.mean(axis=0))
    return points


@pytest.mark.parametrize("scale", [0.91, 1.09])
def test_the_volume_comes_within_its_bound(scale: float) -> None:
    scene, pose = scene_of(BALL + 1.9 * BESIDE)
    points = shrunk(pose, scale)
    assert [own.kind for own in strain_of(scene, pose.centred, points)] == [StrainKind.VOLUME]
    found = with_volume(scene, pose, points)
    assert strain_of(scene, pose.centred, found) == ()
    ratio = volume(found[: len(BALL)], FACES) / volume(BALL, FACES)
    assert abs(ratio - 1.0) == pytest.approx(0.19, abs=0.004)
    assert np.array_equal(found[len(BALL) :], points[len(BALL) :])


def test_it_swells_where_nothing_is_in_the_way() -> None:
    scene, pose = scene_of(BALL + 1.9 * BESIDE)
    points = shrunk(pose, 0.91)
    # A wall just beside it on one side.
    middle = points[: len(BALL)].mean(axis=0)
    points[len(BALL) :] = middle + WALL - [0.95 - 0.91 - 0.0505, 0.0, 0.0]
    before = len(scene.pairs(points, pose.weld))
    found = with_volume(scene, pose, points)
    assert len(scene.pairs(found, pose.weld)) <= before == 0
    moved = np.linalg.norm(found - points, axis=1)[: len(BALL)]
    nearest = np.argmax(BALL[:, 0])
    assert moved[nearest] == 0.0 and moved.max() > 0.002
    kinds = [own.kind for own in strain_of(scene, pose.centred, found) if own.part == 0]
    assert StrainKind.VOLUME not in kinds


def test_what_lost_half_and_what_is_not_strained_stays() -> None:
    scene, pose = scene_of(BALL + 1.9 * BESIDE)
    for scale in (0.7, 0.97):
        points = shrunk(pose, scale)
        assert with_volume(scene, pose, points) is points


def test_what_is_fixed_does_not_swell() -> None:
    pin = (BALL[:, 0] > 0.5).astype(np.float64)
    scene, pose = scene_of(BALL + 1.9 * BESIDE, pin)
    fixed = np.flatnonzero(pin)
    points = shrunk(pose, 0.89)
    points[fixed] = pose.centred[fixed]
    assert [own.kind for own in strain_of(scene, pose.centred, points)] == [StrainKind.VOLUME]
    found = with_volume(scene, pose, points)
    assert np.array_equal(found[fixed], pose.centred[fixed])
    assert strain_of(scene, pose.centred, found) == ()


def test_nothing_swells_beyond_the_limit_of_displacements() -> None:
    scene, pose = scene_of(BALL + 1.9 * BESIDE, limit=0.2)
    points = pose.centred.copy()
    points[: len(BALL)] = BALL * [1.195, 0.805, 0.805]
    limit = 0.2 * (1.0 - 1e-6)
    assert np.linalg.norm(points - pose.centred, axis=1).max() < limit
    found = with_volume(scene, pose, points)
    assert not np.array_equal(found, points)
    assert np.linalg.norm(found - pose.centred, axis=1).max() <= limit


def test_nothing_is_swallowed() -> None:
    pea = 0.001 * BALL + [0.92, 0.0, 0.0]
    scene, pose = scene_of(pea + 3.0 * BESIDE)
    points = shrunk(pose, 0.91)
    points[len(BALL) :] = pea
    found = with_volume(scene, pose, points)
    assert len(scene.enclosed_parts(found, scene.pairs(found, pose.weld))) == 0


def test_a_pinched_limb_swells_beside_what_it_lies_on() -> None:
    along = np.linspace(0.0, 5.0, 100)
    spine = np.stack([along, np.zeros(100), np.zeros(100)], axis=1)
    limb, faces = swept(spine, np.full(100, 0.15), 16, closed=False)
    wall = 0.3 * BALL + [2.5, 0.0, 2.0]
    scene = make_scene([Body(limb, faces), Body(wall, FACES)], RepairOptions())
    pose = detected(scene, gathered(scene, [limb, wall]))
    points = pose.centred.copy()
    points[: len(limb)] = pose.centred[: len(limb)] + (
        swept(spine, np.where(np.abs(along - 2.5) < 0.3, 0.077, 0.15), 16, closed=False)[0] - limb
    )
    before = strain_of(scene, pose.centred, points)
    assert {own.kind for own in before} == {StrainKind.LIMB}
    # It is pressed by a ball beside it, and comes nowhere into that.
    top = points[: len(limb)][np.argmin(np.abs(limb - [2.5, 0.0, 0.15]).sum(axis=1))]
    points[len(limb) :] += top - points[len(limb) :].mean(axis=0)
    points[len(limb) :, 2] += 0.3005
    assert len(scene.pairs(points, pose.weld)) == 0
    found = with_volume(scene, pose, points)
    assert StrainKind.LIMB not in {own.kind for own in strain_of(scene, pose.centred, found)}
    assert len(scene.pairs(found, pose.weld)) == 0
    moved = np.linalg.norm(found - points, axis=1)
    assert moved[: len(limb)].max() > 0.001 and not moved[len(limb) :].any()
