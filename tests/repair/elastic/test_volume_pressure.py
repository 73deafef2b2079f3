"""Inflation: pressure where closed surfaces lack volume, none elsewhere."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import volume
from dtrepair.repair.elastic.volume_pressure import PressureOptions, VolumePressure
from dtrepair.repair.full.relax import relax
from dtrepair.repair.surface.surface import Surface
from tests.meshes import grid, icosphere


def pressure_of(surface: Surface) -> VolumePressure:
    return VolumePressure(surface, surface.rest, np.ones(surface.count))


def force_at(pressure: VolumePressure, pose: FloatArray) -> FloatArray:
    surface = pressure.surface
    return pressure.force(pose, np.ones(surface.count), surface.arap_factor)


def test_what_has_its_volume_is_not_inflated() -> None:
    surface = Surface(*icosphere(2))
    pressure = pressure_of(surface)
    assert pressure.lost(surface.rest) == 0.0
    assert not force_at(pressure, surface.rest).any()
    assert not force_at(pressure, 1.004 * surface.rest).any()


@pytest.mark.parametrize("turned", [False, True])
def test_what_lacks_volume_is_pushed_outwards(turned: bool) -> None:
    points, faces = icosphere(2)
    surface = Surface(points, faces[:, ::-1] if turned else faces)
    pressure = pressure_of(surface)
    small = 0.9 * surface.rest
    assert pressure.lost(small) == pytest.approx(PressureOptions.least_volume - 0.9**3, rel=1e-9)
    force = force_at(pressure, small)
    assert ((force * small).sum(axis=1) > 0).all()
    assert np.abs(pressure.pressure).max() <= PressureOptions.highest
    # Once it is large enough the pressure falls again.
    before = np.abs(pressure.pressure).max()
    force_at(pressure, 1.05 * surface.rest)
    assert np.abs(pressure.pressure).max() < before


@pytest.mark.parametrize("turned", [False, True])
def test_what_has_too_much_volume_is_pulled_inwards(turned: bool) -> None:
    points, faces = icosphere(2)
    surface = Surface(points, faces[:, ::-1] if turned else faces)
    pressure = pressure_of(surface)
    large = 1.1 * surface.rest
    assert pressure.lost(large) == pytest.approx(1.1**3 - PressureOptions.largest_volume, rel=1e-9)
    force = force_at(pressure, large)
    assert ((force * large).sum(axis=1) < 0).all()
    # Once it is small enough the pull eases.
    before = np.abs(pressure.pressure).max()
    force_at(pressure, surface.rest)
    assert np.abs(pressure.pressure).max() < before


def test_each_component_has_its_own_pressure_and_open_ones_have_none() -> None:
    points, faces = icosphere(2)
    sheet, cells = grid(6, 6)
    count = len(points)
    both = np.concatenate([points, points + 5.0, sheet - 5.0])
    surface = Surface(both, np.concatenate([faces, faces + count, cells + 2 * count]))
    pressure = pressure_of(surface)
    pose = surface.rest.copy()
    centre = pose[:count].mean(axis=0)
    pose[:count] = centre + 0.9 * (pose[:count] - centre)
    pose[2 * count :] *= 0.9
    force = force_at(pressure, pose)
    assert force[:count].any() and not force[count:].any()


def test_a_small_component_is_held_as_firmly_as_a_large_one() -> None:
    points, faces = icosphere(2)
    both = np.concatenate([points, 0.1 * points + 5.0])
    surface = Surface(both, np.concatenate([faces, faces + len(points)]))
    pressure, halves = pressure_of(surface), (slice(0, len(points)), slice(len(points), None))
    pose = surface.rest.copy()
    for own in halves:
        pose[own] += 0.3 * (pose[own].mean(axis=0) - pose[own])
    for _ in range(400):  # until no more is allowed
        force_at(pressure, pose)
    large, small = np.abs(pressure.pressure)
    assert small == pytest.approx(10.0 * large, rel=1e-6)


def test_relaxing_gives_volume_back() -> None:
    # Pressed flat: the edges alone would not make it round again at once.
    surface = Surface(*icosphere(3))
    flat = surface.rest * (1.0, 1.0, 0.6)
    reach = np.ones(surface.count)
    relaxed, _ = relax(surface, surface.rest, flat, cycles=12, folds=0, reach=reach)
    whole = volume(surface.rest, surface.faces)
    assert volume(flat, surface.faces) == pytest.approx(0.6 * whole, rel=1e-6)
    assert volume(relaxed, surface.faces) == pytest.approx(whole, rel=0.03)
