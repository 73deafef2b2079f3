from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.usd_stages import CUBE, CUBE_QUADS, cube_file, define_cube, moved_cube, new_stage, vec3f
from usd_io import (
    FrameError,
    MeshSelection,
    StageError,
    UsdIoError,
    open_stage,
    read_frame,
    read_meshes,
    read_points,
    transform_points,
)

NAN = float("nan")


def selection_of(path: Path, **options: object) -> MeshSelection:
    return read_meshes(open_stage(path), **options)  # type: ignore[arg-type]


def edited_cube(tmp_path: Path, edit: Callable[[UsdGeom.Mesh], object], **options: object) -> Path:
    """A file with one cube that a function changed before it was saved."""
    stage = new_stage(tmp_path / "cube.usda")
    edit(define_cube(stage, **options))  # type: ignore[arg-type]
    stage.GetRootLayer().Save()
    return tmp_path / "cube.usda"


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
    defaults = (CUBE * 3, CUBE[:5], CUBE[:0], CUBE * np.float32(np.nan))
    stage = new_stage(tmp_path / "cubes.usda")
    for number, points in enumerate(defaults):
        cube = define_cube(stage, f"/Root/Cube{number}", times=[1.0, 2.0])
        cube.GetPointsAttr().Set(vec3f(points))
    stage.GetRootLayer().Save()
    fitting, *others = selection_of(tmp_path / "cubes.usda").meshes
    assert np.isnan(fitting.rest_time) and fitting.rest.max() == 3.0
    assert fitting.times.tolist() == [1.0, 2.0]
    assert len(others) == 3
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


def test_topology_that_changes_is_refused_or_skipped(tmp_path: Path) -> None:
    def vary(mesh: UsdGeom.Mesh) -> None:
        indices = list(mesh.GetFaceVertexIndicesAttr().Get())
        mesh.GetFaceVertexIndicesAttr().Set(indices, 1.0)
        mesh.GetFaceVertexIndicesAttr().Set(indices, 2.0)
        mesh.GetFaceVertexIndicesAttr().Set(indices[::-1], 3.0)
        other = define_cube(mesh.GetPrim().GetStage(), "/Root/Other")
        other.GetHoleIndicesAttr().Set([1], 1.0)
        other.GetHoleIndicesAttr().Set([2], 2.0)
        define_cube(mesh.GetPrim().GetStage(), "/Root/Fine")

    path = edited_cube(tmp_path, vary)
    with pytest.raises(StageError, match=r"/Root/Cube: .*faceVertexIndices at frame 3"):
        selection_of(path)
    with pytest.raises(StageError, match=r"/Root/Other: .*holeIndices at frame 2"):
        selection_of(path, prim="/Root/Other")
    selection = selection_of(path, skip_varying=True)
    assert [mesh.path for mesh in selection.meshes] == ["/Root/Fine"]
    assert "/Root/Cube" in selection.warnings[0] and "skipped" in selection.warnings[0]
    assert len(selection_of(path, exclude="/Root/Cube /Root/Other").meshes) == 1


def test_equal_topology_samples_are_no_change(tmp_path: Path) -> None:
    def repeat(mesh: UsdGeom.Mesh) -> None:
        for attribute in (mesh.GetFaceVertexIndicesAttr(), mesh.GetFaceVertexCountsAttr()):
            value = attribute.Get()
            attribute.Clear()
            for time in (1.0, 2.0):
                attribute.Set(value, time)

    assert selection_of(edited_cube(tmp_path, repeat)).meshes[0].faces.shape == (12, 3)


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


def clear(mesh: UsdGeom.Mesh) -> None:
    mesh.GetFaceVertexIndicesAttr().Clear()


@pytest.mark.parametrize(
    "index, reason", [(8, "index 8 at corner 5 is out of range: expected 0 to 7"), (-1, "index -1")]
)
def test_indices_out_of_range_are_bad_input(tmp_path: Path, index: int, reason: str) -> None:
    def spoil(mesh: UsdGeom.Mesh) -> None:
        indices = list(mesh.GetFaceVertexIndicesAttr().Get())
        indices[5] = index
        mesh.GetFaceVertexIndicesAttr().Set(indices)

    with pytest.raises(StageError, match=rf"/Root/Cube: .*{reason}"):
        selection_of(edited_cube(tmp_path, spoil))
    # The same with samples only, where the number of points is that of the samples.
    with pytest.raises(StageError, match="/Root/Cube: "):
        selection_of(edited_cube(tmp_path, spoil, times=[1.0]))


def test_bad_frames_are_errors_of_these_frames_only(tmp_path: Path) -> None:
    def spoil(mesh: UsdGeom.Mesh) -> None:
        wrong = CUBE.copy()
        wrong[3, 1] = np.nan
        wrong[5, 2] = np.inf
        mesh.GetPointsAttr().Set(vec3f(wrong), 2.0)
        mesh.GetPointsAttr().Set(vec3f(CUBE[:7]), 3.0)
        mesh.GetPointsAttr().Set(vec3f(CUBE[:0]), 4.0)
        mesh.GetPointsAttr().Set(Sdf.ValueBlock(), 5.0)

    mesh = selection_of(edited_cube(tmp_path, spoil, times=[1.0, 6.0])).meshes[0]
    assert mesh.times.tolist() == [1, 2, 3, 4, 5, 6]
    with pytest.raises(
        FrameError, match="at frame 2: 2 points are NaN or infinite, first 3"
    ) as bad:
        read_frame(mesh, 2.0)
    assert isinstance(bad.value, UsdIoError) and bad.value.exit_code == 4
    with pytest.raises(FrameError, match="expected 8 points as in the topology, got 7"):
        read_frame(mesh, 3.0)
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


def test_holes_and_degenerate_polygons_take_no_part(tmp_path: Path) -> None:
    polygons = [*CUBE_QUADS, [0, 1], [2, 2, 2], [5, 5, 6]]
    path = edited_cube(tmp_path, lambda mesh: mesh.GetHoleIndicesAttr().Set([2]), polygons=polygons)
    mesh = selection_of(path).meshes[0]
    assert sorted(set(mesh.polygons.tolist())) == [0, 1, 3, 4, 5]
    assert any("3 degenerate polygons" in text for text in mesh.warnings)


def test_left_handed_meshes_are_turned_inside_out(tmp_path: Path) -> None:
    right = selection_of(cube_file(tmp_path / "right.usda")).meshes[0]
    left = selection_of(
        edited_cube(tmp_path, lambda mesh: mesh.GetOrientationAttr().Set("leftHanded"))
    ).meshes[0]
    np.testing.assert_array_equal(left.faces, right.faces[:, [0, 2, 1]])


def test_concave_polygons_are_not_fans(tmp_path: Path) -> None:
    outline = [[0, 0, 0], [4, -2, 0], [2, 0, 0], [4, 2, 0], [1, 0.5, 0]]
    path = cube_file(tmp_path / "arrow.usda", points=outline, polygons=[[0, 1, 2, 3, 4]])
    corners = selection_of(path).meshes[0].rest[selection_of(path).meshes[0].faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()


def test_nonmanifold_and_subdivided_meshes_are_warned_of(tmp_path: Path) -> None:
    path = edited_cube(
        tmp_path,
        lambda mesh: mesh.GetSubdivisionSchemeAttr().Set("catmullClark"),
        polygons=[*CUBE_QUADS, [0, 2, 7]],
    )
    selection = selection_of(path)
    # Edge 0-2 has three triangles now; 2-7 is a diagonal of a quad, 7-0 is new.
    assert any("non-manifold" in text for text in selection.warnings)
    assert any("subdivision surface (catmullClark)" in text for text in selection.warnings)


def test_seams_of_coincident_points_are_kept(tmp_path: Path) -> None:
    points = np.concatenate([CUBE, CUBE])
    polygons = [*CUBE_QUADS[:3], *[[corner + 8 for corner in quad] for quad in CUBE_QUADS[3:]]]
    mesh = selection_of(
        cube_file(tmp_path / "seams.usda", points=points, polygons=polygons)
    ).meshes[0]
    assert mesh.rest.shape == (16, 3) and mesh.faces.max() == 15
    np.testing.assert_array_equal(mesh.rest[:8], mesh.rest[8:])


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
