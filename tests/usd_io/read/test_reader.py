from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.usd_reading import edited_cube, selection_of
from tests.usd_stages import CUBE, cube_file, define_cube, moved_cube, new_stage, vec3f
from usd_io import (
    FrameError,
    StageError,
    UsdIoError,
    read_frame,
    read_meshes,
    read_points,
    transform_points,
)

NAN = float("nan")


def test_a_mesh_tells_everything_but_its_frames(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "shot.usda")
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    define_cube(stage, times=[-2.5, 0.0, 1 / 3, 100.0])
    stage.GetRootLayer().Save()
    selection = selection_of(tmp_path / "shot.usda")
    mesh = selection.meshes[0]
    assert selection.warnings == ()
    assert mesh.path == "/Root/Cube"
    assert mesh.times.tolist() == [-2.5, 0.0, 1 / 3, 100.0]
    assert mesh.up.tolist() == [0, 0, 1] and mesh.meters_per_unit == 0.01
    assert mesh.faces.shape == (12, 3) and mesh.faces.dtype == np.int32
    assert mesh.polygons.tolist() == np.repeat(range(6), 2).tolist()
    assert mesh.rest_time == -2.5
    np.testing.assert_array_equal(mesh.rest, moved_cube(-2.5).astype(np.float64))
    for time in mesh.times:
        frame = read_frame(mesh, time)
        assert frame is not None and frame.dtype == np.float32 and not frame.flags.writeable
        np.testing.assert_array_equal(frame, moved_cube(time))
    np.testing.assert_array_equal(
        read_points(mesh, [100.0, 0.0]), [moved_cube(100.0), moved_cube(0.0)]
    )


def test_a_frame_outlives_the_next_frames(tmp_path: Path) -> None:
    # The array shares memory with pxr: it must own a reference, and reading must not collect.
    mesh = selection_of(cube_file(tmp_path / "c.usdc", times=range(50))).meshes[0]
    first = read_frame(mesh, 0.0)
    for time in range(1, 50):
        read_frame(mesh, time)
    np.testing.assert_array_equal(first, moved_cube(0.0))


def test_points_at_the_default_time_only(tmp_path: Path) -> None:
    mesh = selection_of(cube_file(tmp_path / "cube.usda")).meshes[0]
    assert len(mesh.times) == 1 and np.isnan(mesh.times[0]) and np.isnan(mesh.rest_time)
    np.testing.assert_array_equal(read_frame(mesh, mesh.times[0]), CUBE)
    np.testing.assert_array_equal(read_frame(mesh, 7.0), CUBE)


def test_rest_is_the_default_where_it_fits(tmp_path: Path) -> None:
    defaults = (CUBE * 3, CUBE[:5], CUBE[:0], CUBE * np.float32(np.nan), CUBE * 0)
    stage = new_stage(tmp_path / "cubes.usda")
    for number, points in enumerate(defaults):
        cube = define_cube(stage, f"/Root/Cube{number}", times=[1.0, 2.0])
        cube.GetPointsAttr().Set(vec3f(points))
    stage.GetRootLayer().Save()
    fitting, *others = selection_of(tmp_path / "cubes.usda").meshes
    assert np.isnan(fitting.rest_time) and fitting.rest.max() == 3.0
    assert fitting.times.tolist() == [1.0, 2.0]
    assert len(others) == 4
    for other in others:
        assert other.rest_time == 1.0
        np.testing.assert_array_equal(other.rest, moved_cube(1.0))


def test_rest_passes_over_bad_samples(tmp_path: Path) -> None:
    def spoil(mesh: UsdGeom.Mesh) -> None:
        mesh.GetPointsAttr().Set(Sdf.ValueBlock(), 0.0)
        mesh.GetPointsAttr().Set(vec3f(CUBE * np.inf), 0.5)

    mesh = selection_of(edited_cube(tmp_path, spoil, times=[1.0])).meshes[0]
    assert mesh.rest_time == 1.0
    assert mesh.times.tolist() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize(
    "spoil, reason",
    [
        (lambda mesh: mesh.GetPointsAttr().Clear(), "no points"),
        (lambda mesh: mesh.GetPointsAttr().Set(Sdf.ValueBlock()), "no points"),
        (lambda mesh: mesh.GetPointsAttr().Set(vec3f(CUBE[:0])), "is empty"),
        (lambda mesh: mesh.GetFaceVertexCountsAttr().Clear() and clear(mesh), "no faces"),
        (lambda mesh: mesh.GetHoleIndicesAttr().Set([0, 1, 2, 3, 4, 5]), "no faces"),
    ],
)
def test_meshes_without_geometry_are_skipped_unless_named(
    tmp_path: Path, spoil: Callable[[UsdGeom.Mesh], object], reason: str
) -> None:
    path = edited_cube(tmp_path, spoil)
    selection = selection_of(path)
    assert selection.meshes == ()
    assert reason in selection.warnings[0] and selection.warnings[0].endswith("skipped")
    assert selection_of(path, prim="//Cube").meshes == ()
    with pytest.raises(StageError, match=reason):
        selection_of(path, prim="/Root/Cube")


def clear(mesh: UsdGeom.Mesh) -> object:
    return mesh.GetFaceVertexIndicesAttr().Clear()


def test_bad_frames_are_errors_of_these_frames_only(tmp_path: Path) -> None:
    def spoil(mesh: UsdGeom.Mesh) -> None:
        wrong = CUBE.copy()
        wrong[3, 1] = np.nan
        wrong[5, 2] = np.inf
        mesh.GetPointsAttr().Set(vec3f(wrong), 2.0)
        mesh.GetPointsAttr().Set(vec3f(CUBE[:7]), 3.0)
        mesh.GetPointsAttr().Set(vec3f(CUBE[:0]), 4.0)
        mesh.GetPointsAttr().Set(Sdf.ValueBlock(), 5.0)
        wrong[5, 2] = 1.0
        mesh.GetPointsAttr().Set(vec3f(wrong), 5.5)

    mesh = selection_of(edited_cube(tmp_path, spoil, times=[1.0, 6.0])).meshes[0]
    assert mesh.times.tolist() == [1, 2, 3, 4, 5, 5.5, 6]
    with pytest.raises(
        FrameError, match="at frame 2: 2 points are NaN or infinite, first 3"
    ) as bad:
        read_frame(mesh, 2.0)
    assert isinstance(bad.value, UsdIoError) and bad.value.exit_code == 4
    with pytest.raises(FrameError, match="expected 8 points as in the topology, got 7"):
        read_frame(mesh, 3.0)
    with pytest.raises(FrameError, match=r"at frame 5.5: point 3 is NaN or infinite; export"):
        read_frame(mesh, 5.5)
    with pytest.raises(FrameError, match="got 0"):
        read_frame(mesh, 4.0)
    assert read_frame(mesh, 5.0) is None
    np.testing.assert_array_equal(read_frame(mesh, 6.0), moved_cube(6.0))
    with pytest.raises(FrameError, match="frame 5: the sample is blocked"):
        read_points(mesh, [1.0, 5.0])


def test_a_static_mesh_of_nan_is_bad_input(tmp_path: Path) -> None:
    with pytest.raises(StageError, match="NaN or infinite"):
        selection_of(cube_file(tmp_path / "cube.usda", points=CUBE * np.nan))
    only_bad = edited_cube(
        tmp_path, lambda mesh: mesh.GetPointsAttr().Set(vec3f(CUBE * np.nan), 1.0), points=None
    )
    with pytest.raises(StageError, match="no sample has finite points"):
        selection_of(only_bad)


def test_times_are_those_of_the_composed_stage(tmp_path: Path) -> None:
    cube_file(tmp_path / "cube.usda", times=[1.0, 2.0, 4.0])
    layer = Sdf.Layer.CreateNew(str(tmp_path / "shot.usda"))
    layer.subLayerPaths = ["./cube.usda"]
    layer.subLayerOffsets[0] = Sdf.LayerOffset(10.0, 0.1)
    layer.Save()
    mesh = selection_of(tmp_path / "shot.usda").meshes[0]
    composed = mesh.geometry.GetPointsAttr().GetTimeSamples()
    assert mesh.times.tolist() == composed
    np.testing.assert_allclose(mesh.times, [10.1, 10.2, 10.4])
    for time, source in zip(mesh.times, (1.0, 2.0, 4.0), strict=True):
        np.testing.assert_array_equal(read_frame(mesh, time), moved_cube(source))


@pytest.mark.parametrize("key", ["timeCodesPerSecond", "framesPerSecond"])
def test_other_rates_compose_as_pxr_does(tmp_path: Path, key: str) -> None:
    path = cube_file(tmp_path / "cube.usda", times=[1.0, 2.0])
    layer = Sdf.Layer.FindOrOpen(str(path))
    setattr(layer, key, 48.0)
    layer.Save()
    assert selection_of(path).meshes[0].times.tolist() == [1.0, 2.0]


def test_far_points_are_warned_of(tmp_path: Path) -> None:
    far = selection_of(cube_file(tmp_path / "far.usda", points=CUBE + 1e6)).meshes[0]
    assert "float32 steps of 0.0625 units" in far.warnings[0]
    np.testing.assert_array_equal(far.rest, (CUBE + np.float32(1e6)).astype(np.float64))


def test_tiny_meshes_are_read_exactly(tmp_path: Path) -> None:
    tiny = (CUBE * np.float32(1e-4)).astype(np.float32)
    mesh = selection_of(cube_file(tmp_path / "tiny.usdc", points=tiny)).meshes[0]
    assert mesh.warnings == ()
    np.testing.assert_array_equal(mesh.rest, tiny.astype(np.float64))


def test_point3d_data_is_cast(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "double.usda", points=None)
    layer = Sdf.Layer.FindOrOpen(str(path))
    prim = layer.GetPrimAtPath("/Root/Cube")
    attribute = Sdf.AttributeSpec(prim, "points", Sdf.ValueTypeNames.Point3dArray)
    layer.SetTimeSample(attribute.path, 1.0, Vt.Vec3dArray.FromNumpy(CUBE / 3.0))
    layer.Save()
    mesh = selection_of(path).meshes[0]
    assert isinstance(mesh.geometry.GetPointsAttr().Get(1.0), Vt.Vec3dArray)
    frame = read_frame(mesh, 1.0)
    assert frame is not None and frame.dtype == np.float32
    np.testing.assert_array_equal(frame, (CUBE / 3.0).astype(np.float32))


def test_local_space_in_world_space_out(tmp_path: Path) -> None:
    def move(mesh: UsdGeom.Mesh) -> None:
        UsdGeom.Xformable(mesh.GetPrim().GetParent()).AddTranslateOp().Set((1e6, 0, 0))

    from usd_io import world_matrix

    mesh = selection_of(edited_cube(tmp_path, move)).meshes[0]
    np.testing.assert_array_equal(mesh.rest, CUBE)
    world = transform_points(mesh.rest, world_matrix(mesh, NAN))
    np.testing.assert_array_equal(world - [1e6, 0, 0], CUBE)


def test_real_files(shared_data: Path) -> None:
    walk = selection_of(shared_data / "humans" / "walk_male.usdc").meshes
    assert [mesh.path for mesh in walk] == ["/Character/Body"]
    assert walk[0].faces.shape == (26756, 3) and len(walk[0].times) == 60
    frame = read_frame(walk[0], 60.0)
    assert frame is not None and np.isfinite(frame).all()
    sword = selection_of(shared_data / "scenes" / "sword_in_stone.usda").meshes
    assert len(sword) == 2 and sword[0].up.tolist() == [0, 0, 1]
    assert len(selection_of(shared_data / "scenes" / "sleeve_on_arm.usdc").meshes) == 2


def test_stage_or_opened_stage(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "cube.usda")
    assert len(read_meshes(Usd.Stage.Open(str(path))).meshes) == 1
