"""Poses with a few pairs are mended; the last resort is tried once."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.scene import mending
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import detected, gathered
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.surface.surface import Surface
from tests.meshes import grid, icosphere

BALL, FACES = icosphere(2)


def test_what_cannot_be_mended_is_solved_alone_once(monkeypatch: pytest.MonkeyPatch) -> None:
    points, triangles = grid(8, 8, 3.0)
    sheet = points - points.mean(axis=0)
    scene = make_scene([Body(BALL, FACES), Body(sheet, triangles)], RepairOptions())
    pose = detected(scene, gathered(scene, [BALL, sheet]))
    tried = list[tuple[bool, bool]]()

    def mend(
        surface: Surface,
        original: FloatArray,
        starts: Sequence[FloatArray],
        *,
        step: float,
        alone: mending.Alone | None,
        options: MendOptions,
    ) -> FloatArray:
        tried.append((options.push.direction.facing, alone is not None))
        return starts[0]

    monkeypatch.setattr(mending, "mend", mend)
    judged, pairs = mending.mended(
        scene,
        WeldedMeshes(scene)([pose.weld]),
        pose.centred,
        Judged(pose.centred),
        pose.pairs,
        partial(scene.pairs, weld=pose.weld),
        step=0.002,
        options=ClipOptions().mend,
        alone=lambda surface, original: original,
    )
    assert len(pairs) and np.array_equal(pairs, pose.pairs) and judged.points is pose.centred
    assert tried == [(False, True), (True, False)]
