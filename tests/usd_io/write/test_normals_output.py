"""Normals beside written points: indexed where corners share them, left alone or dropped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.meshes import grid_quads
from usd_io import OverrideWriter, join_layers, open_stage, read_frame, read_meshes

POINTS, QUADS = grid_quads(8, 6)
CORNERS = QUADS.reshape(-1)
FRAMES = (1.0, 2.0, 3.0)
LIFT = np.array([1.0, 1.0, 2.0], dtype=np.float32)


def bent(time: float) -> NDArray[np.float32]:
    points: NDArray[np.float32] = np.array(POINTS, dtype=np.float32)
    points[:, 2] = 0.2 * np.sin(3.0 * points[:, 0] + time) + 0.1 * np.sin(4.0 * points[:, 1])
    return np.asarray(points)


def normals_at(time: float) -> NDArray[np.float32]:
    """Smooth, but for a crease along the middle."""
    slope = 3.0 * np.cos(3.0 * POINTS[CORNERS, 0] + time)
    normals = np.stack([-slope, np.zeros_like(slope), np.ones_like(slope)], axis=1)
    centre = POINTS[QUADS].mean(axis=1)[:, 0] > np.median(POINTS[:, 0])
    normals[np.repeat(centre, 4), 1] = 0.5
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.asarray(normals / lengths, dtype=np.float32)


def sheet(path: Path, name: str, *, animated: bool = True) -> Path:
    stage = Usd.Stage.CreateNew(str(path))
    mesh = UsdGeom.Mesh.Define(stage, "/Sheet")
    mesh.CreateFaceVertexCountsAttr([4] * len(QUADS))
    mesh.CreateFaceVertexIndicesAttr(CORNERS.tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    if name == "normals":
        mesh.SetNormalsInterpolation("faceVarying")
        attribute = mesh.CreateNormalsAttr()
    else:
        api = UsdGeom.PrimvarsAPI(mesh)
        kind = Sdf.ValueTypeNames.Normal3fArray
        attribute = api.CreatePrimvar("normals", kind, "faceVarying").GetAttr()
    for time in FRAMES:
        mesh.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(bent(time)), time)
        values = Vt.Vec3fArray.FromNumpy(normals_at(time))
        attribute.Set(values, time) if animated else attribute.Set(values)
    stage.GetRootLayer().Save()
    return path


def write(stage: Path, output: Path, *times: float, **options: Any) -> Path:
    """Write points that are lifted at some times, and keep the others."""
    opened = open_stage(stage)
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, output, settings={}, **options) as writer:
        for time in times or (2.0,):
            points = read_frame(mesh, time)
            assert points is not None
            writer.write(mesh, time, points * LIFT)
        writer.commit()
    return output


def corner_normals(path: Path, time: float) -> NDArray[np.float32] | None:
    """Normals of corners as a client resolves them: primvars before the attribute."""
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Sheet"))
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("normals")
    if primvar and primvar.HasValue():
        assert primvar.GetInterpolation() == "faceVarying"
        return np.asarray(primvar.ComputeFlattened(time))
    value = mesh.GetNormalsAttr().Get(time)
    return None if value is None else np.asarray(value)


def newell(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Unit normals of the quads."""
    first, second = (points[QUADS[:, k + 2]] - points[QUADS[:, k]] for k in (0, 1))
    cross = np.cross(first.astype(np.float64), second)
    return np.asarray(cross / np.linalg.norm(cross, axis=1, keepdims=True))


@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_face_varying_normals_are_indexed_and_lose_nothing(tmp_path: Path, name: str) -> None:
    stage = sheet(tmp_path / "in.usda", name)
    output = write(stage, tmp_path / "out.usdc")
    for time in (1.0, 3.0):
        np.testing.assert_array_equal(corner_normals(output, time), normals_at(time))
    found = corner_normals(output, 2.0)
    assert found is not None and not np.allclose(found, normals_at(2.0), atol=0.05)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-6)
    # Near the normals of their quads, and creased where they were.
    lifted = bent(2.0) * LIFT
    assert (np.einsum("ij,ij->i", found, np.repeat(newell(lifted), 4, axis=0)) > 0.3).all()
    layer = Sdf.Layer.FindOrOpen(str(output))
    stored = layer.QueryTimeSample("/Sheet.primvars:normals", 2.0)
    assert len(stored) < 0.45 * len(CORNERS)
    shared: dict[int, set[Any]] = {vertex: set() for vertex in CORNERS.tolist()}
    for vertex, normal in zip(CORNERS.tolist(), map(tuple, found.tolist()), strict=True):
        shared[vertex].add(normal)
    assert {len(normals) for normals in shared.values()} == {1, 2}


def test_normals_that_part_over_time_stay_apart(tmp_path: Path) -> None:
    stage = sheet(tmp_path / "in.usda", "normals")
    edited = Usd.Stage.Open(str(stage))
    attribute = UsdGeom.Mesh(edited.GetPrimAtPath("/Sheet")).GetNormalsAttr()
    late = normals_at(3.0)
    late[5] = (1.0, 0.0, 0.0)
    attribute.Set(Vt.Vec3fArray.FromNumpy(late), 3.0)
    edited.Save()
    output = write(stage, tmp_path / "out.usdc")
    np.testing.assert_array_equal(corner_normals(output, 3.0), late)
    np.testing.assert_array_equal(corner_normals(output, 1.0), normals_at(1.0))


def test_normals_of_hard_faces_are_written_as_they_are(tmp_path: Path) -> None:
    stage = sheet(tmp_path / "in.usda", "normals")
    edited = Usd.Stage.Open(str(stage))
    attribute = UsdGeom.Mesh(edited.GetPrimAtPath("/Sheet")).GetNormalsAttr()
    for time in FRAMES:
        hard = np.repeat(newell(bent(time)), 4, axis=0).astype(np.float32)
        attribute.Set(Vt.Vec3fArray.FromNumpy(hard), time)
    edited.Save()
    output = write(stage, tmp_path / "out.usdc")
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert not layer.GetAttributeAtPath("/Sheet.primvars:normals")
    assert len(layer.QueryTimeSample("/Sheet.normals", 2.0)) == len(CORNERS)


def test_normals_are_kept_or_dropped(tmp_path: Path) -> None:
    stage = sheet(tmp_path / "in.usda", "normals")
    kept = write(stage, tmp_path / "keep.usdc", normals="keep")
    names: list[str] = []
    Sdf.Layer.FindOrOpen(str(kept)).Traverse("/", lambda path: names.append(str(path)))
    assert not any("normals" in name for name in names)
    for time in FRAMES:
        np.testing.assert_array_equal(corner_normals(kept, time), normals_at(time))
    dropped = write(stage, tmp_path / "drop.usdc", normals="drop")
    assert all(corner_normals(dropped, time) is None for time in FRAMES)
    sizes = [write(stage, tmp_path / "a.usdc").stat().st_size, kept.stat().st_size]
    assert sizes[0] > sizes[1] >= dropped.stat().st_size - 200


def test_indexed_normals_of_chunks_join(tmp_path: Path) -> None:
    stage = sheet(tmp_path / "in.usda", "normals")
    parts = [write(stage, tmp_path / f"{time:g}.usdc", time) for time in (1.0, 3.0)]
    join_layers(parts, tmp_path / "joined.usdc")
    whole = write(stage, tmp_path / "whole.usdc", 1.0, 3.0)
    for time in FRAMES:
        expected = corner_normals(whole, time)
        assert expected is not None
        np.testing.assert_array_equal(corner_normals(tmp_path / "joined.usdc", time), expected)
