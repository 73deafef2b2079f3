"""Inflation: pressure where closed surfaces lack volume, none elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import volume
from dtrepair.repair.elastic.volume_pressure import HIGHEST, LARGEST, LEAST, Inflation
from dtrepair.repair.full.relax import relax
from dtrepair.repair.surface.surface import Surface
from tests.meshes import grid, icosphere


def inflation_of(surface: Surface) -> Inflation:
    return Inflation(surface, surface.rest, np.ones(surface.count))


def force_at(inflation: Inflation, pose: FloatArray) -> FloatArray:
    surface = inflation.surface
    return inflation.force(pose, np.ones(surface.count), surface.rigidity_factor)


def test_what_has_its_volume_is_not_inflated() -> None:
    surface = Surface(*icosphere(2))
    inflation = inflation_of(surface)
    assert inflation.lost(surface.rest) == 0.0
    assert not force_at(inflation, surface.rest).any()
    assert not force_at(inflation, 1.004 * surface.rest).any()


@pytest.mark.parametrize("turned", [False, True])
def test_what_lacks_volume_is_pushed_outwards(turned: bool) -> None:
    points, faces = icosphere(2)
    surface = Surface(points, faces[:, ::-1] if turned else faces)
    inflation = inflation_of(surface)
    small = 0.9 * surface.rest
    assert inflation.lost(small) == pytest.approx(LEAST - 0.9**3, rel=1e-9)
    force = force_at(inflation, small)
    assert ((force * small).sum(axis=1) > 0).all()
    assert np.abs(inflation.pressure).max() <= HIGHEST
    # Once it is large enough the pressure falls again.
    before = np.abs(inflation.pressure).max()
    force_at(inflation, 1.05 * surface.rest)
    assert np.abs(inflation.pressure).max() < before


@pytest.mark.parametrize("turned", [False, True])
def test_what_has_too_much_volume_is_pulled_inwards(turned: bool) -> None:
    points, faces = icosphere(2)
    surface = Surface(points, faces[:, ::-1] if turned else faces)
    inflation = inflation_of(surface)
    large = 1.1 * surface.rest
    assert inflation.lost(large) == pytest.approx(1.1**3 - LARGEST, rel=1e-9)
    force = force_at(inflation, large)
    assert ((force * large).sum(axis=1) < 0).all()
    # Once it is small enough the pull eases.
    before = np.abs(inflation.pressure).max()
    force_at(inflation, surface.rest)
    assert np.abs(inflation.pressure).max() < before


def test_each_component_has_its_own_pressure_and_open_ones_have_none() -> None:
    points, faces = icosphere(2)
    sheet, cells = grid(6, 6)
    count = len(points)
    both = np.concatenate([points, points + 5.0, sheet - 5.0])
    surface = Surface(both, np.concatenate([faces, faces + count, cells + 2 * count]))
    inflation = inflation_of(surface)
    pose = surface.rest.copy()
    centre = pose[:count].mean(axis=0)
    pose[:count] = centre + 0.9 * (pose[:count] - centre)
    pose[2 * count :] *= 0.9
    force = force_at(inflation, pose)
    assert force[:count].any() and not force[count:].any()


def test_relaxing_gives_volume_back() -> None:
    # Pressed flat: the edges alone would not make it round again at once.
    surface = Surface(*icosphere(3))
    flat = surface.rest * (1.0, 1.0, 0.6)
    reach = np.ones(surface.count)
    relaxed, _ = relax(surface, surface.rest, flat, cycles=12, folds=0, reach=reach)
    whole = volume(surface.rest, surface.faces)
    assert volume(flat, surface.faces) == pytest.approx(0.6 * whole, rel=1e-6)
    assert volume(relaxed, surface.faces) == pytest.approx(whole, rel=0.03)
