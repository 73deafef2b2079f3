"""What can be given blend shapes, and what cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from tests.present import present
from tests.usd_reading import defined_in
from tests.usd_stages import CUBE, cube_file, define_cube, new_stage
from usd_io import OpenedStage, StageError, UsageError, open_stage, read_meshes
from usd_io.write.corrections import (
    Correction,
    check_correctable,
    points_of,
    preview,
    write_corrections,
    write_offsets,
)


def lifted(path: Path) -> tuple[OpenedStage, Correction]:
    """A still cube, two of whose corners are lifted by a shape of full weight."""
    opened = open_stage(path)
    mesh = read_meshes(opened).meshes[0]
    shapes = np.full((1, 2, 3), (0.0, 0.0, 0.5), np.float32)
    weights = np.ones((1, 1), np.float32)
    return opened, Correction(mesh, np.array([1, 6]), shapes, np.array([np.nan]), weights)


def expected() -> NDArray[np.float32]:
    points: NDArray[np.float32] = CUBE.copy()
    points[[1, 6], 2] += 0.5
    return points


def test_a_still_mesh_is_corrected_in_memory_and_in_a_file(tmp_path: Path) -> None:
    path, output = cube_file(tmp_path / "in.usda"), tmp_path / "out" / "out.usda"
    output.parent.mkdir()
    opened, correction = lifted(path)
    before = path.read_bytes()
    seen = points_of(preview(opened, [correction]), "/Root/Cube", np.nan)
    np.testing.assert_array_equal(present(seen), expected())
    write_corrections(output, opened, [correction], record={"version": "1"})
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert list(layer.subLayerPaths) == ["../in.usda"]
    # What the input has stays an `over`.
    assert defined_in(output) == {
        "/Root/Cube/repair_Cube_1": "BlendShape",
        "/Root/ShapeAnimation": "SkelAnimation",
        "/Root/ShapeSkeleton": "Skeleton",
    }
    record = layer.customLayerData["dtrepair"]
    assert record["version"] == "1" and record["input"] == "../in.usda"
    found = points_of(Usd.Stage.Open(layer), "/Root/Cube", np.nan)
    np.testing.assert_array_equal(present(found), expected())
    assert path.read_bytes() == before
    with pytest.raises(UsageError, match="part of the input"):
        write_corrections(path, opened, [correction])


def test_payloads_that_were_not_loaded_are_not_loaded_to_count_again(tmp_path: Path) -> None:
    """Nobody looked into them."""
    path = cube_file(tmp_path / "in.usda")
    other = cube_file(tmp_path / "other.usda")
    stage = Usd.Stage.Open(str(path))
    stage.DefinePrim("/Other").GetPayloads().AddPayload(f"./{other.name}")
    stage.GetRootLayer().Save()
    opened = open_stage(path, load_payloads=False)
    mesh = read_meshes(opened).meshes[0]
    shapes, weights = np.ones((1, 1, 3), np.float32), np.ones((1, 1), np.float32)
    correction = Correction(mesh, np.array([1]), shapes, np.array([np.nan]), weights)
    seen = preview(opened, [correction])
    assert other.name not in {Path(layer.realPath).name for layer in seen.GetUsedLayers()}


def test_offsets_of_a_still_mesh_are_its_default(tmp_path: Path) -> None:
    opened, correction = lifted(cube_file(tmp_path / "in.usda"))
    write_offsets(tmp_path / "out.usda", opened, [correction])
    stage = Usd.Stage.Open(str(tmp_path / "out.usda"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Cube"))
    offsets = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("dtrepair:offset").ComputeFlattened()
    np.testing.assert_array_equal(np.asarray(mesh.GetPointsAttr().Get()) + offsets, expected())


def test_animated_points_have_no_rest_for_shapes(tmp_path: Path) -> None:
    mesh = read_meshes(open_stage(cube_file(tmp_path / "in.usda", times=[1.0, 2.0]))).meshes[0]
    with pytest.raises(StageError, match="points are animated"):
        check_correctable(mesh)


def test_a_prop_beside_skinned_parts_is_corrected_below_their_root(tmp_path: Path) -> None:
    """As a sword that a joint's transform moves, in a SkelRoot that is not the topmost prim."""
    stage = new_stage(tmp_path / "in.usda")
    UsdSkel.Root.Define(stage, "/Root/Rig")
    UsdGeom.Xform.Define(stage, "/Root/Rig/Sword")
    define_cube(stage, "/Root/Rig/Sword/Cube")
    stage.GetRootLayer().Save()
    opened, correction = lifted(tmp_path / "in.usda")
    output = tmp_path / "out.usda"
    write_corrections(output, opened, [correction])
    result = Usd.Stage.Open(str(output))
    found = points_of(result, "/Root/Rig/Sword/Cube", np.nan)
    np.testing.assert_array_equal(present(found), expected())
    roots = [str(prim.GetPath()) for prim in result.Traverse() if prim.IsA(UsdSkel.Root)]
    assert roots == ["/Root/Rig"]


def test_a_character_below_would_be_inside_two_roots(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage)
    UsdSkel.Root.Define(stage, "/Root/Hero")
    stage.GetRootLayer().Save()
    mesh = read_meshes(open_stage(tmp_path / "in.usda")).meshes[0]
    with pytest.raises(StageError, match=r"/Root/Hero would lie below it.* --collider, .*--delta$"):
        check_correctable(mesh)
