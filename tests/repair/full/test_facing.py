"""Sheets that meet a closed part where nobody knows their side face it, and leave it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, IntArray, vector_areas
from dtrepair.repair.full.directions import facing_sides
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.push import push
from dtrepair.repair.scene.mending import facing
from dtrepair.repair.surface.surface import Surface
from tests.meshes import grid, icosphere, joined

BALL, FACES = icosphere(3)


def sheet(up: bool) -> tuple[FloatArray, IntArray]:
    """A patch over the top of the ball that dips into it by its hem, its normals up or down."""
    points, faces = grid(12, 12, 1.0)
    x, y = (points - points.min(axis=0))[:, :2].T
    flat = np.stack([x - 0.2, y - 0.5, 0.965 + 0.3 * x], axis=1)
    rises = vector_areas(flat, faces)[:, 2].mean() > 0.0
    return flat, faces if rises == up else faces[:, ::-1].copy()


@pytest.mark.parametrize("up", [True, False])
def test_a_sheet_goes_off_what_it_meets_whatever_way_it_is_turned(up: bool) -> None:
    points, faces = joined((BALL, FACES), sheet(up))
    surface = Surface(points, faces)
    pairs = surface.contacts.pairs(points)
    assert len(pairs) and surface.sheets.sum() == len(faces) - len(FACES)
    region = np.zeros(len(pairs), dtype=np.int32)
    areas = vector_areas(points, faces)
    sides = facing_sides(areas, pairs, region, surface.sheets, None)
    assert np.array_equal(sides, np.where(surface.sheets[pairs], -1.0 if up else 1.0, 1.0))
    options = facing(MendOptions()).push
    pushed = push(surface, points, near=0, step=0.002, options=options)
    assert len(pushed.pairs) == 0
    top = len(BALL)
    assert (pushed.points[top:, 2] - points[top:, 2]).mean() > 0.0
    if up:
        plain = push(surface, points, near=0, step=0.002, options=MendOptions().push)
        assert len(plain.pairs) == len(pairs)  # it only goes deeper


def test_known_sides_and_two_of_a_kind_stay() -> None:
    points, faces = joined((BALL, FACES), sheet(True))
    surface = Surface(points, faces)
    pairs = surface.contacts.pairs(points)
    areas, region = vector_areas(points, faces), np.zeros(len(pairs), dtype=np.int32)
    known = np.where(surface.sheets[pairs], 1.0, -1.0)
    assert np.array_equal(facing_sides(areas, pairs, region, surface.sheets, known), known)
    none = np.zeros(len(faces), dtype=bool)
    assert (facing_sides(areas, pairs, region, none, None) == 1.0).all()


def test_only_the_facing_is_changed() -> None:
    options = MendOptions()
    direction = replace(options.push.direction, facing=True)
    assert facing(options) == replace(options, push=replace(options.push, direction=direction))
