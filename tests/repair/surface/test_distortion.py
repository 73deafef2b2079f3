"""Distortion: what changes edges and moves vertices, in one number."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.metrics import displacements
from dtrepair.repair.surface.distortion import distortion
from dtrepair.repair.surface.surface import Surface
from tests.meshes import torus


def test_distortion_is_edge_change_and_displacement() -> None:
    surface = Surface(*torus())
    pose = surface.rest
    assert distortion(surface, pose, pose) == 0.0
    turned = pose[:, [1, 2, 0]]
    moved = displacements(pose, turned).mean()
    assert distortion(surface, pose, turned) == pytest.approx(2 * moved, rel=1e-12)
    bigger = 1.5 * pose
    expected = np.log(1.5) + 2 * np.linalg.norm(0.5 * pose, axis=1).mean() / diagonal(pose)
    assert distortion(surface, pose, bigger) == pytest.approx(expected, rel=1e-12)
