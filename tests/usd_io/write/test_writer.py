from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from tests.usd_rewriting import points_at, rewrite, times_in
from tests.usd_stages import (
    CUBE,
    authored_properties,
    cube_file,
    define_cube,
    moved_cube,
    new_stage,
    vec3f,
)
from usd_io import (
    OverrideWriter,
    local_points,
    open_stage,
    read_frame,
    read_meshes,
    transform_points,
    world_matrix,
)

NAN = float("nan")


def test_same_times_out_as_in(tmp_path: Path) -> None:
    times = [-7.25, 0.0, 1 / 3, 0.30000000000000004, 100.0]
    path = cube_file(tmp_path / "in.usda", times=times)
    rewrite(path, tmp_path / "out.usdc")
    assert times_in(tmp_path / "out.usdc") == sorted(times)
    for time in times:
        np.testing.assert_array_equal(points_at(tmp_path / "out.usdc", time), moved_cube(time) + 1)


def test_samples_not_written_are_copied_exactly(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(1, 41))
    rewrite(path, tmp_path / "out.usdc", times=range(10, 21))
    assert times_in(tmp_path / "out.usdc") == list(range(1, 41))
    for time in range(1, 41):
        expected = moved_cube(time) + np.float32(10 <= time <= 20)
        found = points_at(tmp_path / "out.usdc", time)
        assert found is not None and found.tobytes() == expected.tobytes()


def test_nothing_but_points_and_extent_is_authored(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    cube = define_cube(stage, times=[1.0, 2.0])
    cube.AddTranslateOp().Set((1, 2, 3))
    UsdGeom.PrimvarsAPI(cube).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray).Set([(0, 0)])
    UsdGeom.Subset.CreateGeomSubset(cube, "top", "face", Vt.IntArray([1]))
    define_cube(stage, "/Root/Other", times=[1.0])
    stage.GetRootLayer().Save()
    rewrite(tmp_path / "in.usda", tmp_path / "out.usda", prim="/Root/Cube")
    assert authored_properties(tmp_path / "out.usda") == {
        "/Root/Cube.points",
        "/Root/Cube.extent",
    }
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    assert layer.subLayerPaths == ["./in.usda"]
    for prim in ("/Root", "/Root/Cube"):
        spec = layer.GetPrimAtPath(prim)
        assert spec.specifier == Sdf.SpecifierOver
        assert set(spec.ListInfoKeys()) == {"specifier"}
    assert layer.GetAttributeAtPath("/Root/Cube.points").typeName == "point3f[]"


def test_composed_times_of_an_offset_layer_stay_exact(tmp_path: Path) -> None:
    cube_file(tmp_path / "anim.usdc", times=range(200))
    layer = Sdf.Layer.CreateNew(str(tmp_path / "shot.usda"))
    layer.subLayerPaths = ["./anim.usdc"]
    layer.subLayerOffsets[0] = Sdf.LayerOffset(0.1, 1 / 3)
    layer.Save()
    mesh = rewrite(tmp_path / "shot.usda", tmp_path / "out.usdc")
    assert len(mesh.times) == 200
    assert times_in(tmp_path / "out.usdc") == mesh.times.tolist()
    for frame in (0, 7, 199):
        found = points_at(tmp_path / "out.usdc", mesh.times[frame])
        np.testing.assert_array_equal(found, moved_cube(frame) + 1)


def test_default_points_stay_default(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda")
    rewrite(path, tmp_path / "out.usdc")
    assert times_in(tmp_path / "out.usdc") == []
    np.testing.assert_array_equal(points_at(tmp_path / "out.usdc", NAN), CUBE + 1)


def test_default_beside_samples_is_left_to_the_input(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage, times=[1.0, 2.0]).GetPointsAttr().Set(vec3f(CUBE * 9))
    stage.GetRootLayer().Save()
    rewrite(tmp_path / "in.usda", tmp_path / "out.usdc")
    np.testing.assert_array_equal(points_at(tmp_path / "out.usdc", NAN), CUBE * 9)
    assert times_in(tmp_path / "out.usdc") == [1.0, 2.0]
    # Even if only the default is written, which would hide all samples of the input.
    rewrite(tmp_path / "in.usda", tmp_path / "rest.usdc", times=[NAN])
    np.testing.assert_array_equal(points_at(tmp_path / "rest.usdc", NAN), CUBE * 9 + 1)
    np.testing.assert_array_equal(points_at(tmp_path / "rest.usdc", 2.0), moved_cube(2.0))


def test_static_points_on_an_animated_transform_get_samples(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    move = define_cube(stage).AddTranslateOp()
    for time in (1.0, 2.0, 3.0, 4.0):
        move.Set((time, 0, 0), time)
    stage.GetRootLayer().Save()
    rewrite(tmp_path / "in.usda", tmp_path / "out.usdc", times=[2.0, 2.5])
    assert times_in(tmp_path / "out.usdc") == [1.0, 2.0, 2.5, 3.0, 4.0]
    for time, change in ((1.0, 0), (2.0, 1), (2.5, 1), (3.0, 0), (4.0, 0), (NAN, 0)):
        np.testing.assert_array_equal(points_at(tmp_path / "out.usdc", time), CUBE + change)


def test_blocked_and_bad_samples_are_kept_as_they_are(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    points = define_cube(stage, times=[1.0, 5.0]).GetPointsAttr()
    bad = CUBE.copy()
    bad[2, 0] = np.nan
    points.Set(Sdf.ValueBlock(), 2.0)
    points.Set(vec3f(bad), 3.0)
    points.Set(vec3f(CUBE[:5]), 4.0)
    stage.GetRootLayer().Save()
    rewrite(tmp_path / "in.usda", tmp_path / "out.usdc", times=[1.0])
    out = tmp_path / "out.usdc"
    assert times_in(out) == [1, 2, 3, 4, 5]
    assert points_at(out, 2.0) is None
    layer = Sdf.Layer.FindOrOpen(str(out))
    assert isinstance(layer.QueryTimeSample("/Root/Cube.points", 2.0), Sdf.ValueBlock)
    kept = points_at(out, 3.0)
    assert kept is not None and kept.tobytes() == bad.tobytes()
    np.testing.assert_array_equal(points_at(out, 4.0), CUBE[:5])
    extent = layer.QueryTimeSample("/Root/Cube.extent", 3.0)
    np.testing.assert_array_equal(extent, [[-1, -1, -1], [1, 1, 1]])


def test_extent_is_always_that_of_the_points(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    cube = define_cube(stage, times=[1.0, 2.0])
    cube.GetExtentAttr().Set([(-9, -9, -9), (9, 9, 9)])
    cube.GetExtentAttr().Set([(-8, -8, -8), (8, 8, 8)], 1.7)
    stage.GetRootLayer().Save()
    rewrite(tmp_path / "in.usda", tmp_path / "out.usdc", times=[2.0])
    result = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    box = UsdGeom.BBoxCache(Usd.TimeCode(2.0), [UsdGeom.Tokens.default_])
    bounds = box.ComputeWorldBound(result.GetPrimAtPath("/Root/Cube")).ComputeAlignedRange()
    expected = moved_cube(2.0) + 1
    np.testing.assert_array_equal(bounds.GetMin(), expected.min(axis=0))
    np.testing.assert_array_equal(bounds.GetMax(), expected.max(axis=0))
    assert times_in(tmp_path / "out.usdc", "extent") == [1.0, 2.0]


def test_static_points_win_over_a_sampled_extent(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage).GetExtentAttr().Set([(-8, -8, -8), (8, 8, 8)], 1.0)
    stage.GetRootLayer().Save()
    rewrite(tmp_path / "in.usda", tmp_path / "out.usdc")
    assert times_in(tmp_path / "out.usdc", "extent") == []
    result = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    extent = result.GetAttributeAtPath("/Root/Cube.extent")
    np.testing.assert_array_equal(extent.Get(1.0), [[0, 0, 0], [2, 2, 2]])


def test_point3d_input_becomes_point3f(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda", points=None)
    layer = Sdf.Layer.FindOrOpen(str(path))
    prim = layer.GetPrimAtPath("/Root/Cube")
    attribute = Sdf.AttributeSpec(prim, "points", Sdf.ValueTypeNames.Point3dArray)
    for time in (1.0, 2.0):
        layer.SetTimeSample(attribute.path, time, Vt.Vec3dArray.FromNumpy(CUBE / 3.0))
    layer.Save()
    rewrite(path, tmp_path / "out.usda", times=[2.0])
    result = Sdf.Layer.FindOrOpen(str(tmp_path / "out.usda"))
    for time in (1.0, 2.0):
        assert isinstance(result.QueryTimeSample("/Root/Cube.points", time), Vt.Vec3fArray)


def test_world_space_and_back(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    cube = define_cube(stage, times=[1.0])
    matrix = Gf.Matrix4d().SetScale(Gf.Vec3d(100, 0.01, 3))
    matrix.SetTranslateOnly(Gf.Vec3d(1e6, 1e6, 1e6))
    cube.MakeMatrixXform().Set(matrix)
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    mesh = read_meshes(opened).meshes[0]
    world = transform_points(mesh.rest, world_matrix(mesh, 1.0))
    with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
        writer.write(mesh, 1.0, local_points(mesh, 1.0, world))
        writer.commit()
    found = points_at(tmp_path / "out.usdc", 1.0)
    assert found is not None
    # 1e6 has steps of 1e-10 in float64; through the scale of 0.01: 1e-8, under float32's own.
    assert np.abs(found - moved_cube(1.0)).max() < 2e-7


def test_uninstanced_meshes_come_through(tmp_path: Path) -> None:
    cube_file(tmp_path / "asset.usda", times=[1.0, 2.0])
    stage = new_stage(tmp_path / "in.usda")
    for name in ("A", "B"):
        prim = UsdGeom.Xform.Define(stage, f"/Root/{name}").GetPrim()
        prim.GetReferences().AddReference("./asset.usda")
        prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    out = tmp_path / "out.usda"
    rewrite(tmp_path / "in.usda", out, prim="/Root/A//", uninstance=True)
    np.testing.assert_array_equal(points_at(out, 1.0, "/Root/A/Cube"), moved_cube(1.0) + 1)
    np.testing.assert_array_equal(points_at(out, 1.0, "/Root/B/Cube"), moved_cube(1.0))
    assert Usd.Stage.Open(str(out)).GetPrimAtPath("/Root/B").IsInstance()
    assert authored_properties(out) == {"/Root/A/Cube.points", "/Root/A/Cube.extent"}


def test_points_of_value_clips(tmp_path: Path) -> None:
    for name, times in (("a", [1.0, 2.0]), ("b", [3.0, 4.0])):
        cube_file(tmp_path / f"{name}.usdc", times=times)
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage, points=None)
    clips = Usd.ClipsAPI(stage.GetPrimAtPath("/Root"))
    clips.SetClipAssetPaths([Sdf.AssetPath("./a.usdc"), Sdf.AssetPath("./b.usdc")])
    clips.SetClipPrimPath("/Root")
    clips.SetClipActive([(1, 0), (3, 1)])
    clips.SetClipTimes([(1, 1), (4, 4)])
    cube_file(tmp_path / "manifest.usda", points=None)
    manifest = Sdf.Layer.FindOrOpen(str(tmp_path / "manifest.usda"))
    points = Sdf.ValueTypeNames.Point3fArray
    Sdf.AttributeSpec(manifest.GetPrimAtPath("/Root/Cube"), "points", points)
    manifest.Save()
    clips.SetClipManifestAssetPath(Sdf.AssetPath("./manifest.usda"))
    stage.GetRootLayer().Save()
    mesh = rewrite(tmp_path / "in.usda", tmp_path / "out.usdc", times=[2.0])
    assert mesh.times.tolist() == times_in(tmp_path / "out.usdc") == [1.0, 2.0, 3.0, 4.0]
    for time in (1.0, 2.0, 3.0, 4.0):
        expected = moved_cube(time) + np.float32(time == 2.0)
        np.testing.assert_array_equal(points_at(tmp_path / "out.usdc", time), expected)


def test_float64_points_are_rounded_and_later_writes_win(tmp_path: Path) -> None:
    opened = open_stage(cube_file(tmp_path / "in.usda", times=[1.0]))
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
        writer.write(mesh, 1.0, CUBE)
        writer.write(mesh, 1.0, CUBE.astype(np.float64) / 3.0)
        writer.commit()
    found = points_at(tmp_path / "out.usdc", 1.0)
    np.testing.assert_array_equal(found, (CUBE.astype(np.float64) / 3.0).astype(np.float32))


def test_meshes_never_named_are_not_in_the_layer(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda", times=[1.0])
    opened = open_stage(path)
    with OverrideWriter(opened, tmp_path / "out.usda", settings={}) as writer:
        writer.commit()
    assert authored_properties(tmp_path / "out.usda") == set()
    np.testing.assert_array_equal(points_at(tmp_path / "out.usda", 1.0), moved_cube(1.0))


def test_real_files_survive_an_untouched_copy(shared_data: Path, tmp_path: Path) -> None:
    for name in (
        "humans/walk_male.usdc",
        "scenes/sleeve_on_arm.usdc",
        "scenes/sword_in_stone.usda",
    ):
        opened = open_stage(shared_data / name)
        meshes = read_meshes(opened).meshes
        out = tmp_path / f"{Path(name).stem}.usdc"
        with OverrideWriter(opened, out, settings={}) as writer:
            for mesh in meshes:
                writer.keep(mesh, mesh.times[0])
            writer.commit()
        copies = read_meshes(open_stage(out)).meshes
        for mesh, copy in zip(meshes, copies, strict=True):
            assert copy.path == mesh.path
            np.testing.assert_array_equal(copy.times, mesh.times)
            np.testing.assert_array_equal(copy.faces, mesh.faces)
            for time in mesh.times:
                original, copied = read_frame(mesh, time), read_frame(copy, time)
                assert original is not None and copied is not None
                assert original.tobytes() == copied.tobytes()
                moves = (world_matrix(mesh, time), world_matrix(copy, time))
                np.testing.assert_array_equal(*moves)
