"""Whole numbers of triangles: primvars of faces or of the mesh, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.present import present
from tests.usd_stages import CUBE_QUADS, define_cube, new_stage
from usd_io import AnimatedMesh, StageError, open_stage, read_meshes
from usd_io.read.face_numbers import read_face_numbers

Write = Callable[..., AnimatedMesh]
SIDES = [3, 1, 4, 1, 5, 9]


@pytest.fixture
def cube(tmp_path: Path) -> Write:
    """A function that saves a cube with a primvar `layer` and reads it as a mesh."""

    def write(values: Any, interpolation: str, kind: str = "IntArray", hole: bool = False) -> Any:
        stage = new_stage(tmp_path / "a.usda")
        geometry = define_cube(stage)
        primvars = UsdGeom.PrimvarsAPI(geometry)
        primvar = primvars.CreatePrimvar("layer", getattr(Sdf.ValueTypeNames, kind), interpolation)
        assert primvar.Set(values)
        if hole:
            geometry.CreateHoleIndicesAttr([1])
        stage.GetRootLayer().Save()
        return read_meshes(open_stage(tmp_path / "a.usda")).meshes[0]

    return write


def test_each_triangle_has_the_number_of_its_face(cube: Write) -> None:
    mesh = cube(SIDES, "uniform")
    numbers = present(read_face_numbers(mesh, "layer"))
    assert numbers.dtype == np.int32 and numbers.tolist() == np.repeat(SIDES, 2).tolist()
    assert np.array_equal(present(read_face_numbers(mesh, "primvars:layer")), numbers)
    assert read_face_numbers(mesh, "other") is None
    assert len(CUBE_QUADS) == len(SIDES)


def test_faces_that_are_left_out_have_none(cube: Write) -> None:
    kept = [number for index, number in enumerate(SIDES) if index != 1]
    numbers = present(read_face_numbers(cube(SIDES, "uniform", hole=True), "layer"))
    assert numbers.tolist() == np.repeat(kept, 2).tolist()


def test_one_number_for_the_mesh(cube: Write) -> None:
    for values, kind in (([7], "IntArray"), (7, "Int"), (7, "UChar")):
        numbers = present(read_face_numbers(cube(values, "constant", kind), "layer"))
        assert numbers.tolist() == [7] * 12


def test_indexed_values_are_taken_apart(cube: Write, tmp_path: Path) -> None:
    cube([10, 20], "uniform")
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    (prim,) = (prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    UsdGeom.PrimvarsAPI(prim).GetPrimvar("layer").SetIndices([0, 0, 1, 1, 0, 1])
    stage.Save()
    mesh = read_meshes(open_stage(tmp_path / "a.usda")).meshes[0]
    numbers = present(read_face_numbers(mesh, "layer"))
    assert numbers.tolist() == np.repeat([10, 10, 20, 20, 10, 20], 2).tolist()


@pytest.mark.parametrize(
    ("values", "interpolation", "kind", "words"),
    [
        (SIDES[:-1], "uniform", "IntArray", "one number for each of 6 faces"),
        ([1, 2], "constant", "IntArray", "one number for each of 6 faces"),
        ([1] * 8, "vertex", "IntArray", "with vertex interpolation"),
        ([1.0] * 6, "uniform", "FloatArray", "expected 32-bit whole numbers, got float"),
        ([2**40] * 6, "uniform", "Int64Array", "expected 32-bit whole numbers, got int64"),
    ],
)
def test_anything_else_is_refused(
    cube: Write, values: Any, interpolation: str, kind: str, words: str
) -> None:
    with pytest.raises(StageError, match=words):
        read_face_numbers(cube(values, interpolation, kind), "layer")
