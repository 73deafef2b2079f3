"""Garments are tied to what they lie over, where they are near it and follow it."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body
from dtrepair.numerics.attached.garments import GarmentOptions, garment_ties
from dtrepair.numerics.attachments import Ties, distances
from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import icosphere, tube

LIMB = tube(24, 40, 0.2, 4.0)
SLEEVE = tube(24, 24, 0.23, 2.0)
SCENE = make_scene([Body(*LIMB), Body(*SLEEVE)], RepairOptions())
NEAR = 0.03 / diagonal(SCENE.centred_rest)


def tied(*poses: FloatArray, near: float = 2.0 * NEAR, follows: float = NEAR) -> Ties:
    """The ties of the sleeve, in a clip of poses of it beside the limb at rest."""
    assert SCENE.covering is not None
    every = [SCENE.centred_rest, *(np.concatenate([LIMB[0], pose]) for pose in poses)]
    options = GarmentOptions(near=near, follows=follows)
    return garment_ties(SCENE.covering, SCENE.enclosures.faces, every, options=options)


def test_a_sleeve_is_tied_to_the_limb_beneath_it() -> None:
    ties = tied()
    assert np.array_equal(np.unique(ties.vertices), np.arange(len(LIMB[0]), len(SCENE.rest)))
    assert len(ties.vertices) == len(SLEEVE[0]) and (ties.triangles < len(LIMB[1])).all()
    away = distances(ties, SCENE.centred_rest, SCENE.enclosures.faces)
    assert (away > 0.02).all() and (away < 0.04).all()
    assert np.allclose(np.linalg.norm(ties.offsets, axis=1), away)


def test_without_layers_nothing_is() -> None:
    assert len(garment_ties(None, SCENE.enclosures.faces, [SCENE.centred_rest]).vertices) == 0


def test_what_is_far_off_is_not() -> None:
    assert len(tied(near=0.5 * NEAR).vertices) == 0


@pytest.mark.parametrize(("flares", "others", "held"), [(1, 0, 0.5), (2, 1, 0.5), (1, 2, 1.0)])
def test_what_does_not_follow_in_half_of_the_poses_is_not(
    flares: int, others: int, held: float
) -> None:
    flared, beside = SLEEVE[0].copy(), SLEEVE[0] * (1.08, 1.08, 1.0)
    flared[flared[:, 2] > 0.0, :2] *= 1.5
    ties = tied(*[flared] * flares, *[beside] * others)
    ends = SCENE.rest[ties.vertices, 2]
    assert abs(len(ends) / len(SLEEVE[0]) - held) < 0.06
    assert held == 1.0 or ends.max() <= 0.0


def test_only_where_garments_can_be_tied_is_there_a_way_with_them() -> None:
    way = WeldedMeshes(SCENE).dressed
    assert way is not None and way.scene.dressed and way.dressed is None
    assert way.scene.held is not None and len(way.scene.held.carried.vertices) == len(SLEEVE[0])
    # They hold, and model no contact.
    assert len(way.scene.held.zones) == 0 and way.scene.attachments is None
    bare = make_scene([Body(*LIMB), Body(*icosphere(2, 0.1))], RepairOptions())
    assert WeldedMeshes(bare).dressed is None
    wide = SLEEVE[0] * (3.0, 3.0, 1.0)
    loose = make_scene([Body(*LIMB), Body(wide, SLEEVE[1])], RepairOptions())
    assert WeldedMeshes(loose).dressed is None
