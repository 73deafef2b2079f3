from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from tests.usd_stages import CUBE, CUBE_QUADS, moved_cube
from usd_io import (
    AuthoredMesh,
    OutputError,
    UsageError,
    open_stage,
    read_frame,
    read_meshes,
    world_matrix,
    write_animation,
)

TIMES = [1.0, 2.5, 4.0]
POINTS = np.stack([moved_cube(time) for time in TIMES])


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, 3, 0] = [0.0, 1.5, 3.0]
    meshes = [
        AuthoredMesh(
            "/Character/Body",
            np.array(CUBE_QUADS),
            points=POINTS,
            rest=CUBE,
            transforms=matrices,
            left_handed=True,
        ),
        AuthoredMesh("/Character/Props/Box", [[0, 1, 2], [0, 2, 3, 4, 5]], rest=CUBE),
    ]
    out = tmp_path / "new.usda"
    write_animation(
        out, meshes, times=TIMES, up="Z", meters_per_unit=0.01, fps=48.0, record={"seed": 7}
    )
    opened = open_stage(out)
    body, box = read_meshes(opened).meshes
    assert (body.path, box.path) == ("/Character/Body", "/Character/Props/Box")
    assert body.times.tolist() == TIMES and np.isnan(box.times).all()
    assert body.up.tolist() == [0, 0, 1] and body.meters_per_unit == 0.01
    np.testing.assert_array_equal(body.rest, CUBE)
    for time, points in zip(TIMES, POINTS, strict=True):
        np.testing.assert_array_equal(read_frame(body, time), points)
    np.testing.assert_array_equal(world_matrix(body, 2.5), matrices[1])
    assert len(box.faces) == 4 and body.warnings == ()
    stage = opened.stage
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.0, 4.0)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 48.0
    assert stage.GetDefaultPrim().GetPath() == "/Character"
    assert body.geometry.GetOrientationAttr().Get() == "leftHanded"
    assert stage.GetRootLayer().customLayerData["dtrepair"] == {"seed": 7}
    extent = body.geometry.GetExtentAttr().Get(2.5)
    np.testing.assert_array_equal(extent, [POINTS[1].min(0), POINTS[1].max(0)])
    np.testing.assert_array_equal(box.geometry.GetExtentAttr().Get(), [[-1] * 3, [1] * 3])


@pytest.mark.parametrize(
    "count, indices, interpolation",
    [(8, None, "vertex"), (24, None, "faceVarying"), (5, np.arange(24) % 5, "faceVarying")],
)
def test_texture_coordinates(
    tmp_path: Path, count: int, indices: NDArray[np.int32] | None, interpolation: str
) -> None:
    st = np.arange(2.0 * count).reshape(-1, 2)
    mesh = AuthoredMesh("/Cube", np.array(CUBE_QUADS), rest=CUBE, st=st, st_indices=indices)
    write_animation(tmp_path / "new.usdc", mesh)
    stage = Usd.Stage.Open(str(tmp_path / "new.usdc"))
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Cube")).GetPrimvar("st")
    assert primvar.GetInterpolation() == interpolation
    expected = st if indices is None else st[indices]
    np.testing.assert_array_equal(primvar.ComputeFlattened(), expected)
    assert stage.GetDefaultPrim().GetPath() == "/Cube"


def test_fixed_transform_and_lists_of_points(tmp_path: Path) -> None:
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    mesh = AuthoredMesh(
        "/A/B", CUBE_QUADS, points=[points.tolist() for points in POINTS], transforms=matrix
    )
    write_animation(tmp_path / "new.usdc", mesh, times=TIMES)
    read = read_meshes(open_stage(tmp_path / "new.usdc")).meshes[0]
    np.testing.assert_array_equal(world_matrix(read, 1.0), matrix)
    assert read.rest_time == 1.0


@pytest.mark.parametrize(
    "options, error, reason",
    [
        ({"path": "Cube"}, UsageError, "not an absolute prim path"),
        ({"path": "/a b"}, UsageError, "not a prim path"),
        ({"path": "/Cube.points"}, UsageError, "not a prim path"),
        ({"points": POINTS[:2]}, ValueError, "expected points for 3 times, got 2"),
        ({"points": None}, ValueError, "got neither"),
        ({"points": POINTS[:, :, :2]}, ValueError, r"expected points \(V, 3\)"),
        ({"points": [POINTS[0], POINTS[1], POINTS[2][:5]]}, ValueError, r"\(8, 3\), got \(5, 3\)"),
        ({"rest": CUBE[:6]}, ValueError, "out of range|expected points"),
        ({"faces": [[0, 1, 8]]}, ValueError, "index 8"),
        ({"st": np.zeros((7, 2))}, ValueError, "expected st"),
        ({"st": np.zeros((8, 3))}, ValueError, "expected st"),
        ({"transforms": np.zeros((2, 4, 4))}, ValueError, "expected transforms"),
        ({"path": "/Cube", "transforms": np.eye(4)}, ValueError, "need a parent"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(
    tmp_path: Path, options: dict[str, Any], error: type[Exception], reason: str
) -> None:
    fine: dict[str, Any] = {"path": "/A/Cube", "faces": CUBE_QUADS, "points": POINTS}
    with pytest.raises(error, match=reason):
        write_animation(tmp_path / "new.usdc", AuthoredMesh(**{**fine, **options}), times=TIMES)
    assert list(tmp_path.iterdir()) == []


def test_outputs_are_checked_and_replaced_whole(tmp_path: Path) -> None:
    mesh = AuthoredMesh("/Cube", CUBE_QUADS, rest=CUBE)
    with pytest.raises(UsageError, match="ending in"):
        write_animation(tmp_path / "new.obj", mesh)
    with pytest.raises(OutputError, match="no directory"):
        write_animation(tmp_path / "a" / "new.usda", mesh)
    with pytest.raises(UsageError, match="expected up Y or Z"):
        write_animation(tmp_path / "new.usda", mesh, up="W")
    for size in (1.0, 2.0):
        write_animation(tmp_path / "new.usda", AuthoredMesh("/Cube", CUBE_QUADS, rest=CUBE * size))
    assert read_meshes(open_stage(tmp_path / "new.usda")).meshes[0].rest.max() == 2.0
    assert [item.name for item in tmp_path.iterdir()] == ["new.usda"]


def test_same_calls_same_bytes(tmp_path: Path) -> None:
    mesh = AuthoredMesh("/A/B", CUBE_QUADS, points=POINTS)
    for name in ("a.usdc", "b.usdc"):
        write_animation(tmp_path / name, mesh, times=TIMES)
    assert (tmp_path / "a.usdc").read_bytes() == (tmp_path / "b.usdc").read_bytes()
    assert Sdf.Layer.FindOrOpen(str(tmp_path / "a.usdc")).subLayerPaths == []
