"""Settling: what is far from all contacts keeps every bit, what is carried stays carried."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.repair.full.method import FullMethod
from dtrepair.repair.full.settle import Settling, _quantiles
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface
from tests.meshes import Mesh, bent_tube, swept, tube
from tests.repair.full.test_pull_back import crossings_and_folds


def curled(curl: float) -> Mesh:
    """A long tube whose last part turns by `curl` radians: from 2 pi on it meets itself."""
    along = 160
    arc = np.linspace(0.0, 8.0, along + 1)
    heading = curl * np.clip((arc - 5.0) / 2.5, 0.0, 1.0)
    middle = 0.5 * (heading[1:] + heading[:-1])
    step = np.stack([np.sin(middle), np.zeros(along), np.cos(middle)], axis=1) * (8.0 / along)
    centre = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    return swept(centre, np.full(along + 1, 0.2), 10, closed=False)


def test_what_is_far_from_all_contacts_keeps_every_bit() -> None:
    rest, faces = curled(0.0)
    surface = Surface(rest, faces)
    pose = curled(5.6)[0] / surface.size
    solved = FullMethod(surface)(pose)
    assert crossings_and_folds(surface, solved.points)[0] == 0
    known = find_defects(surface, pose)
    distance = Settling(surface, pose, known.triangles).distance
    far = distance > 0.3 * diagonal(pose)
    assert far.sum() > 50
    assert np.array_equal(solved.points[far], pose[far])
    everywhere = FullMethod(surface, skip=("settle",))(pose).points
    assert (everywhere[far] != pose[far]).any(axis=1).mean() > 0.9


def straight() -> tuple[Surface, FloatArray, Settling]:
    """A straight tube, pushed sideways at one end, with that end as its only contact."""
    points, faces = tube(12, 60, 0.05, 2.0)
    surface = Surface(points, faces)
    along = surface.rest[:, np.ptp(surface.rest, axis=0).argmax()]
    first = np.argsort(along)[:24]
    touched = np.flatnonzero(np.isin(faces, first).all(axis=1))[:2]
    return surface, along, Settling(surface, surface.rest, touched.astype(np.int32))


@pytest.mark.parametrize(("shift", "returns"), [(0.01, True), (0.2, False)])
def test_a_part_returns_if_that_is_gentle_and_else_it_is_carried(
    shift: float, returns: bool
) -> None:
    surface, _, settling = straight()
    moved = surface.rest + shift * np.eye(3)[np.ptp(surface.rest, axis=0).argmin()]
    known = find_defects(surface, moved)
    settled, still = settling(moved, known, folds=0, strain=0.15)
    assert still.any() == returns
    assert np.array_equal(settled.points[still], surface.rest[still])
    near = settling.distance < 0.04 * diagonal(surface.rest)
    assert near.any() and np.array_equal(settled.points[near], moved[near])
    assert np.array_equal(settled.points, moved) == (not returns)


def test_nothing_is_dirty_after_it() -> None:
    # The tube's ends were apart; back in their places they would cross.
    rest, faces = bent_tube(0.0)
    surface = Surface(rest, faces)
    pose = bent_tube(6.35)[0] / surface.size
    clean = bent_tube(5.6)[0] / surface.size
    known = find_defects(surface, clean)
    assert len(known.crossings) == 0
    touched = np.array([0, 1], dtype=np.int32) + len(faces) // 2
    settled, _ = Settling(surface, pose, touched)(clean, known, folds=0, strain=10.0)
    assert crossings_and_folds(surface, settled.points) == (0, 0)
    assert len(settled.defects.crossings) == 0


def test_what_may_move_fades_in_beside_what_is_still() -> None:
    _, along, settling = straight()
    reach = settling.reach(along > np.median(along))
    assert (reach[along > np.median(along)] == 0).all()
    assert reach[along.argmin()] == 1.0
    assert len(np.unique(reach)) > 4


def test_quantiles_of_groups_are_those_of_each() -> None:
    rng = np.random.default_rng(3)
    values, group = rng.random(500), rng.integers(0, 7, 500).astype(np.int32)
    group[group == 4] = 5
    found = _quantiles(values, group, 0.9)
    for number in range(7):
        own = values[group == number]
        expected = np.quantile(own, 0.9, method="lower") if len(own) else 0.0
        assert found[number] == expected
