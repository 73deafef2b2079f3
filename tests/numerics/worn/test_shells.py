"""Thin closed shells that go round something have two sides, of which one follows the other."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.numerics.worn.layers import Layers
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.shells import Backing, Shell, ShellOptions, thin_shells
from tests.meshes import Mesh, joined, tube
from tests.shelled_limb import THICK, limb, sleeve


def layers_of(first: Mesh, second: Mesh, *closed: bool) -> Layers:
    points, faces = joined(first, second)
    part = np.repeat([0, 1], [len(first[0]), len(second[0])]).astype(np.int32)
    parts = Parts(faces, part, np.array(closed), [points])
    return Layers(parts, [np.zeros((0, 2), dtype=np.int32)])


def shell(sewn: float = 0.24) -> Shell:
    (found,) = thin_shells(layers_of(sleeve(0.0, sewn=sewn), limb(0.0), True, True))
    return found


def backing(points: FloatArray, faces: IntArray, found: Shell) -> Backing:
    return Backing(points, faces[np.isin(faces, found.outer).all(axis=1)], found.inner)


def test_the_sides_of_a_sleeve_are_told_apart() -> None:
    found = shell()
    half = len(sleeve(0.0)[0]) // 2
    assert found.part == 0
    assert found.outer.tolist() == list(range(half))
    assert found.inner.tolist() == list(range(half, 2 * half))


def test_other_parts_are_no_shells() -> None:
    thick = sleeve(0.0, thick=0.12, sewn=0.24)
    assert thin_shells(layers_of(thick, limb(0.0), True, True)) == []
    opened = tube(radius=0.3)
    assert thin_shells(layers_of(opened, limb(0.0), False, True)) == []
    beside = limb(0.0)[0] + (0.6, 0.0, 0.0)
    assert thin_shells(layers_of(sleeve(0.0), (beside, limb(0.0)[1]), True, True)) == []


def test_what_lies_behind_a_limb_is_no_shell_of_it() -> None:
    """A thin closed bag that is open nowhere lies over the limb, but goes round nothing."""
    points, faces = sleeve(0.0)
    front = points.copy()
    front[:, 0] = np.abs(front[:, 0]) + 0.01
    assert thin_shells(layers_of((front, faces), limb(0.0), True, True)) == []


def test_sides_that_are_far_apart_are_none() -> None:
    strict = ShellOptions(thick=0.5)
    layers = layers_of(sleeve(0.0), limb(0.0), True, True)
    assert len(thin_shells(layers)) == 1
    assert thin_shells(layers, options=strict) == []
    assert thin_shells(layers, options=ShellOptions(even=0.51)) == []


def test_what_follows_goes_along_as_a_whole() -> None:
    (points, faces), found = sleeve(0.0), shell()
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = points.copy()
    moved[found.outer] = points[found.outer] @ turn.T + (0.0, 0.0, 0.5)
    follows = backing(points, faces, found)
    shift = follows.followed(points, moved)
    there = points[found.inner] @ turn.T + (0.0, 0.0, 0.5)
    # Half as far again as at rest.
    away = lengths(points[found.inner] + shift - moved[found.outer])
    np.testing.assert_allclose(away, 1.5 * THICK, rtol=0.1)
    assert lengths(points[found.inner] + shift - there).max() < THICK


def test_what_does_not_move_stays() -> None:
    (points, faces), found = sleeve(0.0), shell()
    follows = backing(points, faces, found)
    folded = points.copy()
    folded[found.inner] += np.random.default_rng(0).normal(0.0, 0.05, (len(found.inner), 3))
    np.testing.assert_array_equal(follows.followed(folded, folded), 0.0)


@pytest.mark.parametrize("noise", [0.02, 0.05])
def test_folds_are_gone_where_the_other_side_moved(noise: float) -> None:
    (points, faces), found = sleeve(0.0), shell()
    folded, moved = points.copy(), points.copy()
    folded[found.inner] += np.random.default_rng(1).normal(0.0, noise, (len(found.inner), 3))
    moved[found.outer] += (0.0, 0.0, 0.4)
    shift = backing(points, faces, found).followed(folded, moved)
    away = lengths(folded[found.inner] + shift - moved[found.outer])
    np.testing.assert_allclose(away, 1.5 * THICK, rtol=0.1)
