"""The meshes of a machine, which transforms move about a joint, keep their shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair import RepairOptions
from dtrepair.numerics.geometry import lengths
from dtrepair.pipeline import repair_stage
from dtrepair.pipeline.selection import ObjectSettings, PrimTable
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from tests.command_line import read_samples
from tests.meshes import icosphere, tube
from usd_io import AuthoredMesh, write_animation

PATHS = TRUNK, WING, BALL = "/Bot/Trunk/Mesh", "/Bot/Wing/Mesh", "/Bot/Ball/Mesh"
# The wing, whose root sits in the trunk, turns until it just meets a ball that sits there, too.
ANGLES = (0.8, 0.9, 1.0, 1.05, 1.1, 1.15)


def machine(path: Path) -> Path:
    trunk, (points, faces) = tube(14, 24, 0.25, 2.0), tube(12, 20, 0.1, 1.6)
    wing = (points * (1.0, 0.35, 1.0))[:, [2, 1, 0]] * (1.0, 1.0, -1.0) + (0.75, 0.0, 0.0)
    turns = np.repeat(np.eye(4)[None], len(ANGLES), axis=0)
    for turn, angle in zip(turns, ANGLES, strict=True):
        cosine, sine = np.cos(angle), np.sin(angle)
        turn[:3, :3] = [[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]]
        turn[3, 0] = 0.2
    sway = np.repeat(np.eye(4)[None], len(ANGLES), axis=0)
    sway[:, 3, 1] = turns[:, 3, 1] = 1e-3 * np.arange(len(ANGLES))
    ball = icosphere(1, 0.15)
    meshes = [
        AuthoredMesh(TRUNK, trunk[1], None, rest=trunk[0], transforms=sway),
        AuthoredMesh(WING, faces, None, rest=wing, transforms=turns),
        AuthoredMesh(BALL, ball[1], None, rest=ball[0] + (0.3, 0.0, -0.8), transforms=sway),
    ]
    write_animation(path, meshes, times=np.arange(1.0, 1.0 + len(ANGLES)))
    return path


def bent(output: Path) -> float:
    """How far the points of the meshes are from rigid motions of the first sample, at most."""
    most = 0.0
    for path in PATHS:
        samples = [own.astype(np.float64) for own in read_samples(output, path).values()]
        if not samples:
            continue
        whole = RigidBodies([(0, len(samples[0]))], np.ones(len(samples[0])))
        fitted = [whole.fitted(samples[0], pose) - pose for pose in samples]
        most = max(most, *(float(lengths(off).max()) for off in fitted))
    return most


@pytest.mark.parametrize(
    ("rigid", "clearance", "bends"), [(None, 0.0, False), (False, 0.0, True), (None, 0.004, True)]
)
def test_a_machine_bends_only_where_somebody_asks_for_it(
    rigid: bool | None, clearance: float, bends: bool, tmp_path: Path
) -> None:
    """Two prims say so, or a clearance, for which what is rigid makes no room."""
    path, out = machine(tmp_path / "a.usda"), tmp_path / "b.usdc"
    tables = tuple(
        PrimTable(path=own, settings=ObjectSettings(rigid=rigid), origin="test") for own in PATHS
    )
    options = RepairOptions(clearance=clearance)
    report = repair_stage(path, out, options=options, tables=tables)
    before = [frame.before.pairs for frame in report.frames if frame.before is not None]
    assert [frame.status for frame in report.frames] == ["clean"] * len(ANGLES)
    assert 0 < sum(pairs > 0 for pairs in before) < len(ANGLES)
    assert bent(out) > 1e-4 if bends else bent(out) < 1e-6
    assert not any(frame.left.too_close for frame in report.frames)
