"""What a transform carries beside a body that bends is a prop, unless somebody says how stiff."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dtrepair.numerics.geometry import lengths
from dtrepair.pipeline import PropsFound, repair_stage
from dtrepair.pipeline.selection import ObjectSettings, PrimTable, Selection
from dtrepair.pipeline.stages.object_settings import read_settings
from dtrepair.pipeline.stages.shot.props import find_props
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from tests.command_line import read_samples
from tests.meshes import elbow, icosphere
from tests.observers import Recorder
from usd_io import AuthoredMesh, write_animation

TIMES = [1.0, 2.0, 3.0, 4.0]
POINTS = icosphere(3, 0.12)[0] * [0.5, 6.0, 0.5]
BODY, ROD = "/Shot/Arm", "/Shot/Rod/Rod"


def stage_of(
    path: Path,
    *,
    bends: tuple[float, ...] = (0.1, 0.3, 0.4, 0.5),
    carried: bool = True,
    rod_bends: bool = False,
) -> Path:
    """An arm that bends, and a rod that a transform carries into it."""
    poses = np.stack([elbow(bend)[0] for bend in bends])
    sides = np.array([pose[np.abs(pose[:, 2] - 0.6) < 0.1, 0].max() for pose in poses])
    shift = np.repeat(np.eye(4)[None], 4, axis=0)
    shift[:, 3, 0] = sides + np.array([0.2, 0.08, 0.02, 0.03])
    shift[:, 3, 2] = 0.6
    rods = np.stack([POINTS * [1.0 + k * rod_bends, 1.0, 1.0] for k in (0.0, 0.1, 0.2, 0.3)])
    rod = AuthoredMesh(
        ROD,
        icosphere(3)[1],
        points=rods if rod_bends else None,
        rest=POINTS,
        transforms=shift if carried else shift[0],
    )
    arm = AuthoredMesh(BODY, elbow(0.1)[1], poses, rest=poses[0])
    write_animation(path, [arm, rod], times=TIMES)
    return path


def props_of(path: Path, **own: Any) -> list[str]:
    source = open_source(str(path), Selection())
    tables = [PrimTable(path=ROD, settings=ObjectSettings(**own), origin="test")]
    find_props(source, read_settings(source, tables=tables).each)
    return [mesh.path for mesh in source.meshes if mesh.prop]


def test_what_a_transform_carries_is_a_prop(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda")
    assert props_of(path) == [ROD]
    assert props_of(path, mobility=0.5) == [ROD]


def test_who_says_how_stiff_it_is_decides(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda")
    assert props_of(path, rigid=False) == []
    assert props_of(path, diffusion=50.0) == []


def test_neither_what_stands_still_nor_what_bends_is_one(tmp_path: Path) -> None:
    assert props_of(stage_of(tmp_path / "a.usda", carried=False)) == []
    assert props_of(stage_of(tmp_path / "b.usda", rod_bends=True)) == []
    # Nor anything where no body bends: parts of a machine.
    assert props_of(stage_of(tmp_path / "c.usda", bends=(0.1, 0.1, 0.1, 0.1))) == []


def bends_of(output: Path) -> float:
    """How far the rod's points are from a rigid motion, at most."""
    samples = read_samples(output, ROD)
    whole = RigidBodies([(0, len(POINTS))], np.ones(len(POINTS)))
    poses = [own.astype(np.float64) for own in samples.values()]
    return max(float(lengths(whole.fitted(POINTS, own) - own).max()) for own in poses)


def test_it_keeps_its_shape_and_that_is_told(tmp_path: Path) -> None:
    path, out, host = stage_of(tmp_path / "a.usda"), tmp_path / "b.usdc", Recorder()
    report = repair_stage(path, out, jobs=1, observer=host)
    assert [frame.status for frame in report.frames] == ["clean"] * len(TIMES)
    assert [own.paths for own in host.remarks if isinstance(own, PropsFound)] == [(ROD,)]
    assert bends_of(out) < 1e-6
    other = tmp_path / "c.usdc"
    table = PrimTable(path=ROD, settings=ObjectSettings(rigid=False), origin="test")
    repair_stage(path, other, tables=(table,), jobs=1)
    assert bends_of(other) > 5e-6
