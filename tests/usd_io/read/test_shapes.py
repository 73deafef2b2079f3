"""Spheres, cubes and the like, which are no meshes: they are told, not looked at."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Usd, UsdGeom

from tests.command_line import assert_fails, run
from tests.usd_stages import cube_file, new_stage
from usd_io import SelectionError, StageError, open_stage, read_meshes
from usd_io.read.mesh import shape_warnings


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A mesh beside a set of two balls, an invisible cube and a plane that guides."""
    path = cube_file(tmp_path / "a.usda", times=[1.0, 2.0])
    stage = Usd.Stage.Open(str(path))
    for name in ("A", "B"):
        UsdGeom.Sphere.Define(stage, f"/Root/Set/{name}")
    UsdGeom.Cube.Define(stage, "/Root/Hidden").MakeInvisible()
    UsdGeom.Plane.Define(stage, "/Root/Guide").CreatePurposeAttr("guide")
    UsdGeom.BasisCurves.Define(stage, "/Root/Hair")
    stage.GetRootLayer().Save()
    return path


def test_shapes_that_would_be_selected_are_found(scene: Path) -> None:
    opened = open_stage(scene)
    every = read_meshes(opened)
    assert every.shapes == ("/Root/Set/A (Sphere)", "/Root/Set/B (Sphere)")
    assert read_meshes(opened, exclude="/Root/Set/A").shapes == ("/Root/Set/B (Sphere)",)
    assert read_meshes(opened, prim="/Root/Cube").shapes == ()
    more = read_meshes(opened, include_invisible=True, include_purposes=True)
    assert "/Root/Hidden (Cube)" in more.shapes and "/Root/Guide (Plane)" in more.shapes


@pytest.mark.parametrize("kind", [UsdGeom.TetMesh, UsdGeom.NurbsPatch, UsdGeom.Capsule])
def test_all_that_renders_as_a_surface_is_told(tmp_path: Path, kind: type[UsdGeom.Gprim]) -> None:
    stage = Usd.Stage.Open(str(cube_file(tmp_path / "a.usda")))
    kind.Define(stage, "/Root/Other")
    found = read_meshes(stage)
    assert found.shapes == (f"/Root/Other ({kind.__name__})",)


def test_they_are_told_once(scene: Path) -> None:
    lines = run("check", scene).err.splitlines()
    (told,) = (line for line in lines if "no mesh" in line)
    assert "/Root/Set/A (Sphere), /Root/Set/B (Sphere) are no meshes" in told
    assert "convert to meshes" in told
    assert "no mesh" not in run("check", scene, "--prim", "/Root/Cube").err
    found = [read_meshes(open_stage(scene), exclude="/Root/Set/A")] * 2
    (line,) = shape_warnings(found, named=1)
    assert line.startswith("/Root/Set/B (Sphere) is no mesh")
    found.append(read_meshes(open_stage(scene)))
    assert shape_warnings(found, named=1)[0].startswith("/Root/Set/B (Sphere) and 1 more are")


def test_one_that_is_named_is_refused_by_its_type(scene: Path, tmp_path: Path) -> None:
    with pytest.raises(SelectionError, match="/Root/Set/A is Sphere; convert it to a mesh"):
        read_meshes(open_stage(scene), prim="/Root/Set/A")
    out = tmp_path / "b.usda"
    done = run("repair", scene, "-o", out, "--collider", "/Root/Set/A")
    assert_fails(done, 2, "/Root/Set/A is Sphere; convert it to a mesh")


def test_a_stage_of_nothing_else_says_what_it_has(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    UsdGeom.Sphere.Define(stage, "/Root/Ball")
    stage.GetRootLayer().Save()
    with pytest.raises(StageError, match=r"no active.* mesh; convert /Root/Ball \(Sphere\) to one"):
        read_meshes(open_stage(tmp_path / "a.usda"))
