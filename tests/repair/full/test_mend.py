"""Mending one frame: what a push in vain left as it was is not filled again."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.full.biharmonic_fill import biharmonic_fill
from dtrepair.repair.full.mend import MendOptions, mend
from dtrepair.repair.full.push import PushOptions
from dtrepair.repair.surface.surface import Surface
from tests.meshes import crossing_tubes

# Steps as long as the mesh only make things worse; short ones lead on.
PUSH = PushOptions(patience=1, part=float("inf"))


@pytest.mark.parametrize(("step", "once"), [(1.0, True), (0.002, False)])
def test_a_pose_is_filled_once(step: float, once: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    points, faces = crossing_tubes(24, 32, 0.0)
    surface = Surface(points, faces)
    filled: list[FloatArray] = []

    def noted(surface: Surface, pose: FloatArray, **options: Any) -> Any:
        filled.append(pose)
        return biharmonic_fill(surface, pose, **options)

    monkeypatch.setattr("dtrepair.repair.full.mend.biharmonic_fill", noted)
    pose = points / surface.size
    mend(surface, pose, [pose], step=step, options=MendOptions(near=(0, 0, 0), push=PUSH))
    assert (len(filled) == 1) == once
    assert all(not np.array_equal(a, b) for a, b in pairwise(filled))
