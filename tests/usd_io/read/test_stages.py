from __future__ import annotations

import os
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdUtils

from tests.usd_stages import cube_file, define_cube, new_stage
from usd_io import StageError, open_stage, read_meshes


def test_missing_empty_garbage_and_truncated_files(tmp_path: Path) -> None:
    whole = cube_file(tmp_path / "whole.usdc", times=range(20)).read_bytes()
    (tmp_path / "empty.usd").touch()
    (tmp_path / "garbage.usdc").write_bytes(b"\x07garbage" * 40)
    (tmp_path / "truncated.usdc").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "broken.usda").write_text('#usda 1.0\ndef Mesh "x {\n')
    (tmp_path / "mesh.obj").write_text("v 0 0 0\n")
    expected = {
        "missing.usd": "no such file",
        "empty.usd": "0 bytes",
        "garbage.usdc": "cannot be opened",
        "truncated.usdc": "truncated",
        "broken.usda": "cannot be opened",
        "mesh.obj": "not a USD file",
        "": "is a directory",
    }
    for name, reason in expected.items():
        with pytest.raises(StageError, match=reason) as caught:
            open_stage(tmp_path / name)
        assert caught.value.exit_code == 3
        assert "\n" not in str(caught.value) and len(str(caught.value)) < 500
    with pytest.raises(StageError, match="path is empty"):
        open_stage("")


def test_a_file_without_permission_is_no_damaged_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = cube_file(tmp_path / "shot.usda")
    # Whoever runs the tests as root may read every file.
    monkeypatch.setattr(os, "access", lambda given, mode: str(given) != str(path))
    with pytest.raises(StageError, match=r"shot\.usda: cannot be read: no permission"):
        open_stage(path)


def test_broken_references_are_warnings_or_strict_errors(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = cube_file(tmp_path / "shot.usda")
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.subLayerPaths = ["./gone.usda"]
    layer.Save()
    opened = open_stage(path)
    assert len(opened.warnings) == 1 and "gone.usda" in opened.warnings[0]
    assert len(read_meshes(opened).meshes) == 1
    with pytest.raises(StageError, match=r"shot.usda: composition error: .*gone\.usda"):
        open_stage(path, strict=True)
    assert capfd.readouterr().err == "", "pxr printed its own warning"


def test_strict_takes_a_whole_stage(tmp_path: Path) -> None:
    assert open_stage(cube_file(tmp_path / "shot.usda"), strict=True).warnings == ()


def test_payloads_are_loaded_unless_told_not_to(tmp_path: Path) -> None:
    cube_file(tmp_path / "asset.usda")
    stage = new_stage(tmp_path / "shot.usda")
    define_cube(stage, "/Root/Plain")
    stage.DefinePrim("/Root/Loaded").GetPayloads().AddPayload("./asset.usda")
    stage.GetRootLayer().Save()
    paths = [mesh.path for mesh in read_meshes(open_stage(tmp_path / "shot.usda")).meshes]
    assert paths == ["/Root/Plain", "/Root/Loaded/Cube"]
    without = open_stage(tmp_path / "shot.usda", load_payloads=False)
    assert "1 payloads are not loaded" in without.warnings[0]
    assert [mesh.path for mesh in read_meshes(without).meshes] == ["/Root/Plain"]


def test_usdz_is_read(tmp_path: Path) -> None:
    cube_file(tmp_path / "cube.usdc", times=[1.0, 2.0])
    package = str(tmp_path / "cube.usdz")
    assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "cube.usdc"), package)
    mesh = read_meshes(open_stage(package)).meshes[0]
    assert mesh.times.tolist() == [1.0, 2.0]


def test_a_mesh_keeps_its_stage_alive(tmp_path: Path) -> None:
    mesh = read_meshes(open_stage(cube_file(tmp_path / "cube.usda"))).meshes[0]
    assert isinstance(mesh.stage, Usd.Stage)
    assert UsdGeom.Mesh(mesh.prim).GetPointsAttr().Get() is not None
    mesh.stage.RemovePrim(mesh.path)
    with pytest.raises(StageError, match="no longer on the stage"):
        _ = mesh.prim


def test_a_path_object_is_as_good_as_text(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "cube.usda")
    assert open_stage(path).path == os.fspath(path)
