"""A repaired layer is looked at as the stage below it: what was modelled there stays so."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.modelled.unrepaired import unrepaired
from dtrepair.pipeline.selection import ObjectOptions, Selection
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.repair.options import RepairOptions
from tests.meshes import icosphere, tube
from tests.pipeline.hosts import Listener

TIMES = 1.0 + np.arange(10)


def jointed_rods(path: Path) -> Path:
    """Two rods, one end in the other but at first, and a ball that hits the joint in one frame."""
    from usd_io import AuthoredMesh, write_animation

    moves = np.tile(np.eye(4), (3, len(TIMES), 1, 1))
    moves[1, 0, 3, 2] = 3.0
    moves[2, :, 3, 0] = np.where(TIMES == 5.0, 0.35, 1.5)
    meshes = [tube(12, 20, 0.2, 2.0), tube(12, 20, 0.23, 2.0), icosphere(2, 0.2)]
    places = [(0.0, 0.0, 0.0), (0.05, 0.01, 1.7), (0.0, 0.0, 0.85)]
    made = [
        AuthoredMesh(
            path=f"/Root/{name}/Mesh", faces=faces, rest=points + np.array(place), transforms=move
        )
        for name, (points, faces), place, move in zip("ABC", meshes, places, moves, strict=True)
    ]
    write_animation(path, made, times=TIMES)
    return path


@pytest.fixture(scope="module")
def repaired(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("repaired")
    out = folder / "out.usdc"
    report = repair_stage(jointed_rods(folder / "in.usda"), out)
    assert all(frame.status == "clean" for frame in report.frames)
    assert sum(frame.before.pairs for frame in report.frames if frame.before) > 0
    # All of them have points over time now, as what deforms from a bind pose has.
    stage = Usd.Stage.Open(str(out))
    changed = (UsdGeom.Mesh(stage.GetPrimAtPath(f"/Root/{name}/Mesh")) for name in "AB")
    assert all(mesh.GetPointsAttr().GetNumTimeSamples() > 1 for mesh in changed)
    return out


def test_a_check_of_a_repaired_layer_finds_what_the_repair_told(repaired: Path) -> None:
    before, after = check_stage(repaired.parent / "in.usda"), check_stage(repaired)
    assert all(frame.status == "clean" for frame in after.frames)
    assert len(before.attached) == len(after.attached) == 1
    modelled = [frame.after.modelled_pairs for frame in after.frames if frame.after]
    assert modelled[0] == 0 and min(modelled[1:]) > 0


def test_what_is_repaired_already_is_left_as_it_is(repaired: Path, tmp_path: Path) -> None:
    report = repair_stage(repaired, tmp_path / "again.usdc")
    assert not any(frame.displacement_max for frame in report.frames)
    assert all(frame.status == "clean" for frame in check_stage(tmp_path / "again.usdc").frames)


def test_stages_of_other_meshes_tell_nothing(repaired: Path, tmp_path: Path) -> None:
    for name in ("in.usda", "out.usdc"):
        shutil.copy(repaired.parent / name, tmp_path)
    source = open_source(str(tmp_path / "out.usdc"), Selection(frames="5"))
    below = unrepaired(source)
    assert below.all_times.tolist() == TIMES.tolist()
    assert unrepaired(below) is below
    # The stage below has changed since.
    turned = tube(12, 20, 0.2, 2.0)[1][:, ::-1]
    stage = Usd.Stage.Open(str(tmp_path / "in.usda"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/A/Mesh"))
    mesh.GetFaceVertexIndicesAttr().Set(turned.ravel().tolist())
    assert unrepaired(source) is source


def test_what_counted_in_the_repair_and_not_in_the_check_is_told(tmp_path: Path) -> None:
    path, out = jointed_rods(tmp_path / "in.usda"), tmp_path / "out.usdc"
    pair, other = "/Root/A//,/Root/C//", "/Root/B//,/Root/C//"
    repair_stage(
        path,
        out,
        objects=ObjectOptions(ignore=(pair,), detach=(other,)),
        options=RepairOptions(rest_contacts="repair"),
    )
    told = f'repaired with --detach "{other}" --ignore "{pair}" --rest-contacts repair, and counted'
    cases: list[tuple[Path, Any, bool]] = [
        (out, {}, True),
        (out, {"ignore": (pair,), "detach": (other,), "rest_contacts": "repair"}, False),
        (path, {}, False),
    ]
    for stage, choices, warns in cases:
        host = Listener()
        check_stage(stage, observer=host, **choices)
        assert any(own.startswith(told) for own in host.warnings) == warns
        assert any(own.startswith("repaired with") for own in host.warnings) == warns
