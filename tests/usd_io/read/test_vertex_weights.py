"""Weights of vertices: primvars and GeomSubsets, and what is refused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, UsdGeom

from tests.present import present
from tests.usd_stages import CUBE_QUADS, define_cube, new_stage
from usd_io import AnimatedMesh, StageError, open_stage, read_meshes
from usd_io.read.vertex_weights import read_vertex_directions, read_vertex_weights

Change = Callable[[UsdGeom.Mesh], None]
Reader = Callable[[Change], AnimatedMesh]

RAMP = [k / 7 for k in range(8)]


@pytest.fixture
def cube(tmp_path: Path) -> Reader:
    """A function that saves the cube after a change and reads it as a mesh."""
    stage = new_stage(tmp_path / "a.usda")
    geometry = define_cube(stage)

    def read(change: Change) -> AnimatedMesh:
        change(geometry)
        stage.GetRootLayer().Save()
        return read_meshes(open_stage(tmp_path / "a.usda")).meshes[0]

    return read


def primvar(
    name: str,
    values: Any,
    interpolation: str = "vertex",
    kind: Sdf.ValueTypeName = Sdf.ValueTypeNames.FloatArray,
    time: float | None = None,
) -> Change:
    def change(geometry: UsdGeom.Mesh) -> None:
        made = UsdGeom.PrimvarsAPI(geometry).CreatePrimvar(name, kind, interpolation)
        made.Set(values) if time is None else made.Set(values, time)

    return change


def subset(name: str, kind: str, indices: Sequence[int]) -> Change:
    def change(geometry: UsdGeom.Mesh) -> None:
        UsdGeom.Subset.CreateGeomSubset(geometry, name, kind, indices)

    return change


def test_vertex_primvar_with_and_without_its_namespace(cube: Reader) -> None:
    mesh = cube(primvar("pin", RAMP))
    assert np.allclose(present(read_vertex_weights(mesh, "pin")), RAMP, atol=1e-7)
    assert np.allclose(present(read_vertex_weights(mesh, "primvars:pin")), RAMP, atol=1e-7)


@pytest.mark.parametrize(
    ("values", "interpolation", "kind"),
    [
        ([0, 1] * 4, "varying", Sdf.ValueTypeNames.IntArray),
        ([False, True] * 4, "vertex", Sdf.ValueTypeNames.BoolArray),
        ([0.0, 1.0] * 4, "vertex", Sdf.ValueTypeNames.DoubleArray),
    ],
)
def test_other_number_types(cube: Reader, values: Any, interpolation: str, kind: Any) -> None:
    mesh = cube(primvar("pin", values, interpolation, kind))
    assert present(read_vertex_weights(mesh, "pin")).tolist() == [0, 1] * 4


def test_constant_and_animated_primvars(cube: Reader) -> None:
    assert (
        present(read_vertex_weights(cube(primvar("a", [0.25], "constant")), "a")).tolist()
        == [0.25] * 8
    )
    scalar = primvar("b", 0.5, "constant", Sdf.ValueTypeNames.Float)
    assert present(read_vertex_weights(cube(scalar), "b")).tolist() == [0.5] * 8
    assert np.allclose(present(read_vertex_weights(cube(primvar("c", RAMP, time=3)), "c")), RAMP)


def test_indexed_primvar(cube: Reader) -> None:
    def change(geometry: UsdGeom.Mesh) -> None:
        made = UsdGeom.PrimvarsAPI(geometry).CreatePrimvar(
            "pin", Sdf.ValueTypeNames.FloatArray, "vertex"
        )
        made.Set([1.0, 0.0])
        made.SetIndices([0, 1, 1, 1, 1, 1, 1, 0])

    assert present(read_vertex_weights(cube(change), "pin")).tolist() == [1, 0, 0, 0, 0, 0, 0, 1]


def test_subsets_of_points_and_faces(cube: Reader) -> None:
    assert present(read_vertex_weights(cube(subset("tip", "point", [1, 6])), "tip")).tolist() == [
        0, 1, 0, 0, 0, 0, 1, 0,
    ]  # fmt: skip
    weights = present(read_vertex_weights(cube(subset("side", "face", [2])), "side"))
    assert np.flatnonzero(weights).tolist() == sorted(CUBE_QUADS[2])


def test_nothing_of_that_name(cube: Reader) -> None:
    assert read_vertex_weights(cube(primvar("pin", RAMP)), "pins") is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (primvar("pin", RAMP[:7]), r"expected one number for each of 8 vertices, got \(7,\)"),
        (primvar("pin", [0.5] * 6, "uniform"), "uniform interpolation"),
        (primvar("pin", [2.0] * 8), "from 0 to 1"),
        (primvar("pin", [float("nan")] * 8), "from 0 to 1"),
        (primvar("pin", ["a"] * 8, kind=Sdf.ValueTypeNames.StringArray), "expected a number"),
        (subset("pin", "point", [8]), r"below 8 \(points\), got 8"),
        (subset("pin", "face", [-1]), r"below 6 \(faces\), got -1"),
        (subset("pin", "edge", [0]), "face or point, got edge"),
    ],
)
def test_unusable_weights_are_refused(cube: Reader, change: Change, message: str) -> None:
    with pytest.raises(StageError, match=message):
        read_vertex_weights(cube(change), "pin")


def test_vectors_of_vertices(cube: Reader) -> None:
    kind = Sdf.ValueTypeNames.Vector3fArray
    mesh = cube(primvar("out", [(k, 0, -k) for k in range(8)], kind=kind))
    vectors = present(read_vertex_directions(mesh, "out"))
    assert vectors.tolist() == [[k, 0, -k] for k in range(8)]
    assert read_vertex_directions(mesh, "in") is None
    mesh = cube(primvar("all", [(0, 2, 0)], "constant", kind))
    assert present(read_vertex_directions(mesh, "all")).tolist() == [[0, 2, 0]] * 8


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (primvar("out", RAMP), "expected one vector for each of 8 vertices"),
        (
            primvar("out", [(0, 0, float("inf"))] * 8, kind=Sdf.ValueTypeNames.Vector3fArray),
            "finite vectors",
        ),
    ],
)
def test_unusable_vectors_are_refused(cube: Reader, change: Change, message: str) -> None:
    with pytest.raises(StageError, match=message):
        read_vertex_directions(cube(change), "out")
