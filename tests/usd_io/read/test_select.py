from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.usd_stages import cube_file, define_cube, new_stage
from usd_io import SelectionError, StageError, open_stage, read_meshes
from usd_io.expressions import matching_paths


def paths_of(path: Path, **options: Any) -> list[str]:
    return [mesh.path for mesh in read_meshes(open_stage(path), **options).meshes]


@pytest.fixture
def crowd(tmp_path: Path) -> Path:
    stage = new_stage(tmp_path / "crowd.usda")
    for path in ("/Root/hero/Body", "/Root/hero/Coat/Cloth", "/Root/other/Body"):
        define_cube(stage, path)
    stage.GetRootLayer().Save()
    return tmp_path / "crowd.usda"


HERO = ["/Root/hero/Body", "/Root/hero/Coat/Cloth"]
OTHER = ["/Root/other/Body"]


@pytest.mark.parametrize(
    "expression, expected",
    [
        ("//{isa:Mesh}", HERO + OTHER),
        ("//hero//{isa:Mesh}", HERO),
        ("//hero//", HERO),
        ("/Root/hero/*", HERO[:1]),
        ("/Root/hero/Body", HERO[:1]),
        ("Root/hero/Body", HERO[:1]),
        ("//Body", [HERO[0], *OTHER]),
        ("//{isa:Mesh} - /Root/hero//", OTHER),
        ("//Cloth /Root/other/Body", [HERO[1], *OTHER]),
    ],
)
def test_expressions(crowd: Path, expression: str, expected: list[str]) -> None:
    assert paths_of(crowd, prim=expression) == expected


def test_exclude(crowd: Path) -> None:
    assert paths_of(crowd, exclude="//hero//") == OTHER
    assert paths_of(crowd, prim="//Body", exclude="//hero//") == OTHER


def test_selection_leaves_the_stage_as_it_was(crowd: Path) -> None:
    stage = Usd.Stage.Open(str(crowd))
    before = stage.GetSessionLayer().ExportToString()
    assert len(matching_paths(stage, "//{isa:Mesh}")) == 3
    with pytest.raises(SelectionError):
        matching_paths(stage, "//{no:such}")
    assert stage.GetSessionLayer().ExportToString() == before


@pytest.mark.parametrize(
    "expression, reason",
    [
        ("", "is empty"),
        ("{bad", "Ill-formed|parse error"),
        ("//hero//{no:such}", "No registered function 'no'"),
        ("/Nobody", "no match among the active, .* meshes; the stage has /Root/hero/Body"),
        ("/Root/hero/Bdy", r"the stage has .*; is /Root/hero/Body meant\?$"),
        ("/Root/Heroo//", r"; is /Root/hero// meant\?$"),
        ("/Root/hero/Shoes", "the stage has [^?]*$"),
        ("/Root/hero/Body{isa:Sphere}", "the stage has [^?]*$"),
        ("/Root/hero", "'/Root/hero//' for the meshes below it"),
    ],
)
def test_bad_expressions_are_usage_errors(crowd: Path, expression: str, reason: str) -> None:
    with pytest.raises(SelectionError, match=reason) as caught:
        paths_of(crowd, prim=expression)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_an_exclusion_that_matches_nothing_is_told(crowd: Path) -> None:
    opened = Usd.Stage.Open(str(crowd))
    assert not read_meshes(opened, exclude="//hero//").warnings
    (warning,) = read_meshes(opened, exclude="(/Root/hero/Bdy) + (/Root/other)").warnings
    assert warning.startswith("exclude /Root/hero/Bdy: matches no prim")
    assert warning.endswith("; is /Root/hero/Body meant?")


@pytest.mark.parametrize(
    "expression, left",
    [
        ("/Root/hero", OTHER),
        ("/Root/*er*", []),
        ("/Root/her*/Co*", [HERO[0], *OTHER]),
        ("(/Root/hero/Coat) + (/Root/other)", HERO[:1]),
        ("/Root/hero - /Root/hero/Coat", [HERO[1], *OTHER]),
        ("~/Root/hero", HERO),
        ("// - /Root/hero", HERO),
        ("/Root & (/Root/other + /Root/hero/Coat)", HERO[:1]),
    ],
)
def test_what_lies_below_an_excluded_group_is_excluded(
    crowd: Path, expression: str, left: list[str]
) -> None:
    stage = Usd.Stage.Open(str(crowd))
    cube = define_cube(stage, "/Kept").GetPath()
    found = read_meshes(stage, prim="//{isa:Mesh}", exclude=f"({expression}) - {cube}")
    assert [mesh.path for mesh in found.meshes] == [*left, str(cube)]
    assert not found.warnings


def test_an_exclusion_that_matches_no_mesh_is_told(crowd: Path) -> None:
    stage = Usd.Stage.Open(str(crowd))
    UsdGeom.Xform.Define(stage, "/Root/hero/Rig/Arm")
    UsdGeom.Sphere.Define(stage, "/Root/Ball")
    found = read_meshes(stage, exclude="(/Root/hero/R*) + (/Root/other) + (/Root/Ball)")
    assert [mesh.path for mesh in found.meshes] == HERO
    assert found.warnings == (
        "exclude /Root/hero/R*: matches /Root/hero/Rig (untyped), where no mesh is, "
        "and leaves nothing out",
    )


def test_everything_excluded(crowd: Path) -> None:
    with pytest.raises(StageError, match="no active, defined and loaded mesh besides"):
        paths_of(crowd, exclude="//")
    with pytest.raises(SelectionError, match="does not exclude"):
        paths_of(crowd, prim="//Body", exclude="//Body")


def test_inactive_undefined_and_class_prims_are_no_match(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "shot.usda")
    define_cube(stage, "/Root/Off").GetPrim().SetActive(False)
    define_cube(stage, "/Root/Over").GetPrim().SetSpecifier(Sdf.SpecifierOver)
    define_cube(stage, "/Root/Class").GetPrim().SetSpecifier(Sdf.SpecifierClass)
    stage.GetRootLayer().Save()
    with pytest.raises(StageError, match="no active, defined and loaded mesh"):
        paths_of(tmp_path / "shot.usda")
    for name in ("Off", "Over", "Class"):
        with pytest.raises(SelectionError, match="no match"):
            paths_of(tmp_path / "shot.usda", prim=f"/Root/{name}")


def test_invisible_and_purposes_are_skipped_with_a_warning(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "shot.usda")
    define_cube(stage, "/Root/Shown")
    define_cube(stage, "/Root/Group/Hidden")
    UsdGeom.Xform.Define(stage, "/Root/Group").MakeInvisible()
    blinking = define_cube(stage, "/Root/Blinking").GetVisibilityAttr()
    blinking.Set("invisible", 1.0)
    blinking.Set("inherited", 2.0)
    for purpose in ("proxy", "guide", "render"):
        define_cube(stage, f"/Root/{purpose}").GetPurposeAttr().Set(purpose)
    stage.GetRootLayer().Save()
    path = tmp_path / "shot.usda"
    selection = read_meshes(open_stage(path))
    assert {mesh.path for mesh in selection.meshes} == {
        "/Root/Shown",
        "/Root/Blinking",
        "/Root/render",
    }
    assert len(selection.warnings) == 3
    hidden = "/Root/Group/Hidden: invisible (--include-invisible takes it); skipped"
    guide = "/Root/guide: purpose guide (--include-purposes takes it); skipped"
    assert {hidden, guide} <= set(selection.warnings)
    assert "/Root/Group/Hidden" in paths_of(path, include_invisible=True)
    assert {"/Root/proxy", "/Root/guide"} <= set(paths_of(path, include_purposes=True))
    with pytest.raises(SelectionError, match="no usable mesh: /Root/Group/Hidden: invisible"):
        paths_of(path, prim="/Root/Group/Hidden")


def test_point_instancer_prototypes_are_skipped(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "shot.usda")
    instancer = UsdGeom.PointInstancer.Define(stage, "/Root/Grass")
    define_cube(stage, "/Root/Grass/Blade")
    define_cube(stage, "/Root/Elsewhere/Leaf")
    define_cube(stage, "/Root/ElsewhereElse")
    instancer.CreatePrototypesRel().SetTargets(["/Root/Grass/Blade", "/Root/Elsewhere"])
    stage.GetRootLayer().Save()
    selection = read_meshes(open_stage(tmp_path / "shot.usda"))
    assert [mesh.path for mesh in selection.meshes] == ["/Root/ElsewhereElse"]
    assert len(selection.warnings) == 2
    assert all("prototype of a point instancer" in text for text in selection.warnings)


@pytest.fixture
def instances(tmp_path: Path) -> Path:
    """Two instances of an asset that holds an instance itself, and a plain cube."""
    cube_file(tmp_path / "leaf.usda")
    asset = new_stage(tmp_path / "asset.usda")
    define_cube(asset, "/Root/Body")
    leaf = UsdGeom.Xform.Define(asset, "/Root/Leaf").GetPrim()
    leaf.GetReferences().AddReference("./leaf.usda")
    leaf.SetInstanceable(True)
    asset.GetRootLayer().Save()
    stage = new_stage(tmp_path / "shot.usda")
    define_cube(stage, "/Root/Plain")
    for name in ("A", "B"):
        prim = UsdGeom.Xform.Define(stage, f"/Root/{name}").GetPrim()
        prim.GetReferences().AddReference("./asset.usda")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    return tmp_path / "shot.usda"


def test_instance_proxies_are_an_error_with_a_hint(instances: Path) -> None:
    with pytest.raises(StageError, match=r"/Root/A/Body: lies in the instance /Root/A, .*--uninst"):
        paths_of(instances)
    assert paths_of(instances, prim="/Root/Plain") == ["/Root/Plain"]


def test_instance_proxies_beside_others_may_be_read(instances: Path) -> None:
    found = read_meshes(open_stage(instances), instances=True)
    assert [(mesh.path, mesh.instanced) for mesh in found.meshes] == [
        ("/Root/Plain", False),
        ("/Root/A/Body", True),
        ("/Root/A/Leaf/Cube", True),
        ("/Root/B/Body", True),
        ("/Root/B/Leaf/Cube", True),
    ]
    (warning,) = found.warnings
    assert "/Root/A/Body: lies in the instance /Root/A" in warning and "3 more meshes)" in warning
    found = read_meshes(open_stage(instances), instances=True, prim="/Root/A//")
    assert found.warnings[0].endswith(
        "(and 1 more mesh); it is left as it is; --uninstance lets it change"
    )


def test_uninstance_expands_nested_instances(instances: Path) -> None:
    selection = read_meshes(open_stage(instances), prim="/Root/A//", uninstance=True)
    above = {mesh.path: mesh.uninstanced for mesh in selection.meshes}
    assert above == {
        "/Root/A/Body": ("/Root/A",),
        "/Root/A/Leaf/Cube": ("/Root/A", "/Root/A/Leaf"),
    }
    assert not any(mesh.prim.IsInstanceProxy() for mesh in selection.meshes)
    stage = selection.meshes[0].stage
    assert stage.GetPrimAtPath("/Root/B").IsInstance(), "an instance nobody asked for was expanded"


def test_many_meshes_in_one_asset(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "asset.usda")
    for number in range(59):
        define_cube(stage, f"/Root/Part{number:02d}")
    stage.GetRootLayer().Save()
    assert len(paths_of(tmp_path / "asset.usda")) == 59
