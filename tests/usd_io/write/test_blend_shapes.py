"""Blend shapes: written and read back, sparse, over a stage, and refused where they cannot be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdSkel

import usd_io
from tests.present import present
from tests.usd_reading import defined_in
from tests.usd_stages import CUBE, CUBE_QUADS, cube_file
from usd_io.read.blend_shapes import BlendShapes, in_turn, read_blend_shapes
from usd_io.write.authoring import AuthoredMesh
from usd_io.write.blend_shapes import valid_names, write_shapes, write_shapes_over


def two_shapes() -> BlendShapes:
    """One corner out, and a shift of all points; exact in float32."""
    offsets = np.zeros((2, 8, 3))
    offsets[0, 3] = (0.5, 0.25, 0.0)
    offsets[1] = (0.0, 0.0, 2.0)
    weights = np.array([[0.0, 1.0], [0.5, 0.25], [1.0, 0.0]])
    return BlendShapes(("smile", "rise"), offsets, np.array([1.0, 2.5, 4.0]), weights)


def only_mesh(path: Path) -> tuple[usd_io.OpenedStage, usd_io.AnimatedMesh]:
    opened = usd_io.open_stage(path)
    return opened, usd_io.read_meshes(opened).meshes[0]


@pytest.fixture
def written(tmp_path: Path) -> Path:
    mesh = AuthoredMesh("/Face/Mesh", CUBE_QUADS, rest=CUBE)
    write_shapes(tmp_path / "face.usda", mesh, two_shapes(), up="Z", fps=30.0, record={"a": 1})
    return tmp_path / "face.usda"


def test_a_new_stage_reads_back(written: Path) -> None:
    opened, mesh = only_mesh(written)
    shapes = two_shapes()
    found = read_blend_shapes(mesh)
    assert found is not None and found.names == shapes.names and found.skipped == ()
    assert (found.offsets == shapes.offsets).all() and (found.weights == shapes.weights).all()
    assert (found.times == shapes.times).all()
    stage = opened.stage
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and stage.GetTimeCodesPerSecond() == 30.0
    assert stage.GetDefaultPrim().GetTypeName() == "SkelRoot"
    assert all(defined_in(written).values()) and {"/Face", "/Face/Mesh"} <= set(defined_in(written))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.0, 4.0)
    assert stage.GetRootLayer().customLayerData["dtrepair"]["a"] == 1


def test_the_mesh_moves_with_the_weights(written: Path) -> None:
    _opened, mesh = only_mesh(written)
    shapes = two_shapes()
    for time, row in zip(shapes.times, shapes.weights, strict=True):
        expected = CUBE + np.tensordot(row, shapes.offsets, 1)
        assert np.abs(present(usd_io.read_frame(mesh, time)) - expected).max() < 1e-6


def test_only_moving_points_are_stored(written: Path) -> None:
    opened, _ = only_mesh(written)
    shape = UsdSkel.BlendShape(opened.stage.GetPrimAtPath("/Face/Mesh/smile"))
    assert list(shape.GetPointIndicesAttr().Get()) == [3]
    assert len(shape.GetOffsetsAttr().Get()) == 1


def test_a_layer_over_a_stage(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "cube.usda")
    before = path.read_bytes()
    output = tmp_path / "sub" / "shapes.usdc"
    output.parent.mkdir()
    write_shapes_over(output, *only_mesh(path), two_shapes())
    assert path.read_bytes() == before
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert list(layer.subLayerPaths) == ["../cube.usda"]
    assert sorted(defined_in(output)) == [
        *("/Root/Cube/rise", "/Root/Cube/smile", "/Root/ShapeAnimation", "/Root/ShapeSkeleton")
    ]
    opened, mesh = only_mesh(output)
    assert opened.warnings == () and mesh.skinned
    assert opened.stage.GetPrimAtPath("/Root").GetTypeName() == "SkelRoot"
    expected = CUBE + two_shapes().offsets[0]
    assert np.abs(present(usd_io.read_frame(mesh, 4.0)) - expected).max() < 1e-6
    assert not layer.GetAttributeAtPath("/Root/Cube.points")


def test_targets_that_cannot_have_shapes(written: Path, tmp_path: Path) -> None:
    with pytest.raises(usd_io.StageError, match="skinned already"):
        write_shapes_over(tmp_path / "o.usda", *only_mesh(written), two_shapes())
    path = tmp_path / "root.usda"
    usd_io.write_animation(path, AuthoredMesh("/Cube", CUBE_QUADS, rest=CUBE))
    with pytest.raises(usd_io.StageError, match="put it under an Xform"):
        write_shapes_over(tmp_path / "o.usda", *only_mesh(path), two_shapes())
    cube = cube_file(tmp_path / "cube.usda")
    with pytest.raises(usd_io.UsageError):
        write_shapes_over(cube, *only_mesh(cube), two_shapes())
    assert not (tmp_path / "o.usda").exists()


def test_a_mesh_without_shapes_has_none(tmp_path: Path) -> None:
    assert read_blend_shapes(only_mesh(cube_file(tmp_path / "a.usda"))[1]) is None


def test_weights_that_are_missing_show_each_shape_in_turn(written: Path) -> None:
    opened, mesh = only_mesh(written)
    opened.stage.GetPrimAtPath("/Face/ShapeAnimation").GetAttribute("blendShapeWeights").Clear()
    found = read_blend_shapes(mesh)
    assert found is not None and (found.weights == np.eye(2)).all()
    assert (found.times == (1.0, 2.0)).all() and (in_turn(2)[1] == np.eye(2)).all()


def test_in_between_shapes_are_named(written: Path) -> None:
    opened, mesh = only_mesh(written)
    shape = UsdSkel.BlendShape(opened.stage.GetPrimAtPath("/Face/Mesh/smile"))
    shape.CreateInbetween("half").SetWeight(0.5)
    found = read_blend_shapes(mesh)
    assert found is not None and [name.split(":")[0] for name in found.skipped] == ["smile"]


def test_damaged_shapes_are_refused(written: Path) -> None:
    opened, mesh = only_mesh(written)
    shape = UsdSkel.BlendShape(opened.stage.GetPrimAtPath("/Face/Mesh/smile"))
    for indices in ([8], [-1], [1, 2]):
        shape.GetPointIndicesAttr().Set(indices)
        with pytest.raises(usd_io.StageError, match="expected offsets for indices below 8"):
            read_blend_shapes(mesh)
    opened.stage.RemovePrim("/Face/Mesh/smile")
    with pytest.raises(usd_io.StageError, match="no blend shape at /Face/Mesh/smile"):
        read_blend_shapes(mesh)
    binding = UsdSkel.BindingAPI(mesh.prim)
    binding.GetBlendShapeTargetsRel().SetTargets(["/Face/Mesh/rise"])
    with pytest.raises(usd_io.StageError, match="target for each of 2 blend shapes, got 1"):
        read_blend_shapes(mesh)


def test_names_are_made_valid_and_unique() -> None:
    names = valid_names(["smile", "9", "a b", "a-b", "smile"])
    assert names == ("smile", "_9", "a_b", "a_b_2", "smile_2")
    assert all(Sdf.Path.IsValidIdentifier(name) for name in names)


def test_other_clients_see_valid_stages(written: Path) -> None:
    stage = Usd.Stage.Open(str(written))
    cache = UsdSkel.Cache()
    root = UsdSkel.Root(stage.GetPrimAtPath("/Face"))
    assert cache.Populate(root, Usd.PrimDefaultPredicate)
    bindings = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    assert len(bindings) == 1 and len(bindings[0].GetSkinningTargets()) == 1
