"""Modelled contacts, which detection leaves out as those who ask for pairs would."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import MOST_WORDS, NO_TIES, Attachments

TRIANGLES = 300


def _soup(seed: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return triangles that lie through each other: points (V, 3), faces (F, 3)."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(size=(TRIANGLES, 1, 3)) + rng.normal(scale=0.15, size=(TRIANGLES, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * TRIANGLES, dtype=np.int32).reshape(-1, 3)


def _attachments(seed: int, parts: int, zones: float, third: float) -> Attachments:
    """Return random parts with a share of all zones, and of pairs that a third part tells of."""
    rng = np.random.default_rng(seed)
    part_of = rng.integers(parts, size=TRIANGLES).astype(np.int32)
    part_of[0] = parts - 1
    keys = np.flatnonzero(rng.uniform(size=TRIANGLES * parts) < zones)
    both = np.triu(rng.uniform(size=(parts, parts)) < third, 1)
    return Attachments(part_of, keys, NO_TIES, by_third=np.flatnonzero(both))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("parts", "zones", "third"),
    [(3, 0.3, 1.0), (12, 0.2, 0.7), (70, 0.2, 0.2), (150, 0.15, 0.1), (4, 0.0, 1.0)],
)
def test_pairs_without_modelled_ones(seed: int, parts: int, zones: float, third: float) -> None:
    points, faces = _soup(seed)
    attachments = _attachments(seed, parts, zones, third)
    detector = Detector(points, faces)
    every, known = detector(points), detector.zones_of(attachments)
    modelled = attachments.modelled(every)
    assert modelled.any() == (zones > 0.0)
    assert not modelled.all()
    assert np.array_equal(detector(points, zones=known), every[~modelled])
    if modelled.any():
        single = points[None].astype(np.float32)
        rows = detector.candidates(single, zones=known)
        assert len(rows) < len(detector.candidates(single)), "they are not even tested"
    active = np.arange(TRIANGLES) % 3 == 0
    some = active[every].any(axis=1) & ~modelled
    assert np.array_equal(detector(points, active=active, zones=known), every[some])
    assert np.array_equal(detector(points), every), "what was asked before is not remembered"


def test_parts_too_many_for_bits_leave_all_pairs() -> None:
    points, faces = _soup(0)
    attachments = _attachments(0, 64 * MOST_WORDS + 1, 0.1, 1.0)
    detector = Detector(points, faces)
    found = detector(points, zones=detector.zones_of(attachments))
    assert np.array_equal(found, detector(points))
    assert attachments.modelled(found).any()


def test_a_mesh_without_triangles_has_no_zones() -> None:
    detector = Detector(np.zeros((3, 3)), np.zeros((0, 3), dtype=np.int32))
    none = Attachments(np.zeros(0, np.int32), np.zeros(0, np.int64), NO_TIES)
    assert len(detector(np.zeros((3, 3)), zones=detector.zones_of(none))) == 0
