from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel

from tests.present import present
from tests.skinned_box import (
    BOX,
    MESH,
    SKELETON,
    bent,
    blend_shaped,
    only_mesh,
    skinned_file,
    skinned_stage,
)
from tests.usd_stages import authored_properties, define_cube, new_stage, vec3f
from usd_io import (
    OverrideWriter,
    StageError,
    join_layers,
    open_stage,
    read_frame,
    read_meshes,
    transform_points,
    world_matrix,
)


def test_frames_between_sparse_keys_are_skinned(tmp_path: Path) -> None:
    skinned_file(tmp_path / "in.usda")
    mesh = only_mesh(tmp_path / "in.usda")
    assert mesh.skinned
    assert mesh.times.tolist() == list(range(31))
    for time in mesh.times:
        np.testing.assert_allclose(present(read_frame(mesh, time)), bent(3.0 * time), atol=2e-6)
    # What interpolating the keys would give at frame 15 is off by a good part of the box.
    straight = (bent(0.0) + bent(90.0)) / 2
    assert np.abs(straight - bent(45.0)).max() > 0.3
    np.testing.assert_allclose(mesh.rest, bent(0.0), atol=1e-12)


def test_without_a_bind_transform_points_are_bound_where_they_are(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "plain.usda")
    stage.GetPrimAtPath("/Root/A").RemoveProperty("primvars:skel:geomBindTransform")
    stage.GetRootLayer().Save()
    mesh = only_mesh(tmp_path / "plain.usda")
    assert mesh.times.tolist() == np.arange(31.0).tolist()
    np.testing.assert_allclose(present(read_frame(mesh, 0.0)), BOX + SKELETON - MESH, atol=1e-5)


def test_keys_agree_with_baking(tmp_path: Path) -> None:
    skinned_file(tmp_path / "in.usda")
    mesh = only_mesh(tmp_path / "in.usda")
    baked = Usd.Stage.Open(Usd.Stage.Open(str(tmp_path / "in.usda")).Flatten())
    assert UsdSkel.BakeSkinning(UsdSkel.Root(baked.GetPrimAtPath("/Root")), Gf.Interval(0, 30))
    points = UsdGeom.Mesh(baked.GetPrimAtPath("/Root/A"))
    for time in (0.0, 30.0):
        matrix = np.array(points.ComputeLocalToWorldTransform(time))
        theirs = transform_points(points.GetPointsAttr().Get(time), matrix)
        frame = read_frame(mesh, time)
        assert frame is not None
        ours = transform_points(frame, world_matrix(mesh, time))
        np.testing.assert_allclose(ours, theirs, atol=2e-6)


def test_fractional_keys_and_whole_frames(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda", keys={-1.5: 0.0, 2.25: 90.0})
    stage.GetRootLayer().Save()
    mesh = only_mesh(tmp_path / "in.usda")
    assert mesh.times.tolist() == [-1.5, -1.0, 0.0, 1.0, 2.0, 2.25]


def test_transforms_between_mesh_and_skeleton_count(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda", keys={0.0: 0.0})
    move = UsdGeom.Xformable(stage.GetPrimAtPath("/Root/Skeleton")).GetOrderedXformOps()[0]
    move.Set((0, 1, 0), 0.0)
    move.Set((0, 4, 0), 2.0)
    # What both share moves the world, not the points.
    UsdGeom.Xformable(stage.GetPrimAtPath("/Root")).GetOrderedXformOps()[0].Set((9, 9, 9), 50.0)
    stage.GetRootLayer().Save()
    mesh = only_mesh(tmp_path / "in.usda")
    assert mesh.times.tolist() == [0.0, 1.0, 2.0]
    np.testing.assert_allclose(
        present(read_frame(mesh, 1.0)), bent(0.0) + np.array([0, 1.5, 0]), atol=2e-6
    )


def test_written_meshes_are_unbound_and_others_are_not(tmp_path: Path) -> None:
    skinned_file(tmp_path / "in.usda", names="AB")
    opened = open_stage(tmp_path / "in.usda")
    mesh = read_meshes(opened, prim="/Root/A").meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usda", settings={}) as writer:
        writer.write(mesh, 10.0, bent(30.0) + 1.0)
        writer.commit()
        assert [text.partition(":")[0] for text in writer.warnings] == ["/Root/A"]
    assert authored_properties(tmp_path / "out.usda") == {"/Root/A.points", "/Root/A.extent"}
    out = Usd.Stage.Open(str(tmp_path / "out.usda"))
    cache = UsdSkel.Cache()
    root = UsdSkel.Root(out.GetPrimAtPath("/Root"))
    assert out.GetPrimAtPath("/Root").GetTypeName() == "SkelRoot"
    cache.Populate(root, Usd.PrimDefaultPredicate)
    bindings = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    bound = [str(query.GetPrim().GetPath()) for b in bindings for query in b.GetSkinningTargets()]
    assert bound == ["/Root/B"], "a client would deform the written points once more"
    again, other = read_meshes(open_stage(tmp_path / "out.usda")).meshes
    assert not again.skinned and other.skinned
    assert again.times.tolist() == list(range(31))
    # Kept frames look as they did, written ones as written.
    for time in (0.0, 15.0, 30.0):
        np.testing.assert_allclose(present(read_frame(again, time)), bent(3.0 * time), atol=2e-6)
    np.testing.assert_allclose(present(read_frame(again, 10.0)), bent(30.0) + 1.0, atol=2e-6)


def test_normals_of_skinned_meshes_follow_in_kept_frames_too(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda")
    cube = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/A"))
    cube.CreateNormalsAttr().Set(vec3f([(0, -1, 0)] * 4 + [(0, 1, 0)] * 2))
    cube.SetNormalsInterpolation("uniform")
    cube.CreateVelocitiesAttr().Set(vec3f(BOX * 0))
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usda", settings={}) as writer:
        writer.keep(mesh, 30.0)
        writer.commit()
    out = Usd.Stage.Open(str(tmp_path / "out.usda"))
    normals = np.array(out.GetAttributeAtPath("/Root/A.normals").Get(30.0))
    # The top of the box looks along -x after a quarter turn, the bottom still down.
    np.testing.assert_allclose(normals[3], [-1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(normals[2], [0, -1, 0], atol=1e-6)
    velocities = out.GetAttributeAtPath("/Root/A.velocities").Get(15.0)
    assert np.linalg.norm(velocities, axis=1).max() > 1.0


def test_joined_chunks_stay_unbound(tmp_path: Path) -> None:
    skinned_file(tmp_path / "in.usda")
    parts = []
    for name, times in (("a.usdc", range(0, 15)), ("b.usdc", range(15, 31))):
        opened = open_stage(tmp_path / "in.usda")
        mesh = read_meshes(opened).meshes[0]
        with OverrideWriter(opened, tmp_path / name, settings={}) as writer:
            for time in times:
                writer.write(mesh, time, bent(3.0 * time) + 1.0)
            writer.commit()
        parts.append(tmp_path / name)
    join_layers(parts, tmp_path / "all.usdc")
    again = only_mesh(tmp_path / "all.usdc")
    assert not again.skinned
    for time in range(31):
        np.testing.assert_allclose(
            present(read_frame(again, time)), bent(3.0 * time) + 1.0, atol=2e-6
        )


def test_a_skeleton_at_rest(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda", keys={})
    animation = UsdSkel.Animation(stage.GetPrimAtPath("/Root/Animation"))
    turn = Gf.Quatf(Gf.Rotation((0, 0, 1), 90).GetQuat())
    animation.CreateRotationsAttr([Gf.Quatf(1), turn])
    stage.GetRootLayer().Save()
    mesh = only_mesh(tmp_path / "in.usda")
    assert np.isnan(mesh.times).all()
    np.testing.assert_allclose(present(read_frame(mesh, mesh.times[0])), bent(90.0), atol=2e-6)
    UsdSkel.BindingAPI(stage.GetPrimAtPath("/Root/Skeleton")).GetAnimationSourceRel().SetTargets([])
    stage.GetRootLayer().Save()
    mesh = only_mesh(tmp_path / "in.usda")
    np.testing.assert_allclose(present(read_frame(mesh, mesh.times[0])), bent(0.0), atol=2e-6)


def test_blend_shapes_alone_stay_in_local_space(tmp_path: Path) -> None:
    blend_shaped(tmp_path / "in.usda", joints=False)
    mesh = only_mesh(tmp_path / "in.usda")
    np.testing.assert_array_equal(mesh.rest, BOX)
    expected = BOX.astype(np.float64)
    expected[4:, 2] += 0.5 * 2
    np.testing.assert_allclose(present(read_frame(mesh, 5.0)), expected, atol=1e-6)


def test_blend_shapes_come_before_the_joints(tmp_path: Path) -> None:
    blend_shaped(tmp_path / "in.usda", joints=True)
    mesh = only_mesh(tmp_path / "in.usda")
    expected = bent(15.0)
    expected[4:, 2] += 0.5 * 2
    np.testing.assert_allclose(present(read_frame(mesh, 5.0)), expected, atol=2e-6)
    assert mesh.times.tolist() == list(range(31))


def test_skins_that_do_not_fit_are_bad_input(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda")
    prim = stage.GetPrimAtPath("/Root/A")
    UsdSkel.BindingAPI(prim).GetJointIndicesPrimvar().Set([0, 1, 0])
    stage.GetRootLayer().Save()
    with pytest.raises(StageError, match=r"/Root/A .*cannot be skinned.*exclude"):
        only_mesh(tmp_path / "in.usda")


def test_inherited_influences_cannot_be_unbound(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda")
    root = UsdSkel.BindingAPI.Apply(stage.GetPrimAtPath("/Root"))
    root.CreateSkeletonRel().SetTargets(["/Root/Skeleton"])
    root.CreateJointIndicesPrimvar(True, 1).Set([0])
    root.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    define_cube(stage, "/Root/Rigid")
    stage.GetRootLayer().Save()
    for name in ("Rigid", "A"):
        # Unbound, A would fall back on the influences of its parent.
        with pytest.raises(StageError, match=f"/Root/{name}: inherits joint influences from /Root"):
            only_mesh(tmp_path / "in.usda", prim=f"/Root/{name}")


def test_meshes_beside_the_skeleton_are_plain(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda")
    define_cube(stage, "/Root/Plain", times=[1.0])
    stage.GetRootLayer().Save()
    assert not only_mesh(tmp_path / "in.usda", prim="/Root/Plain").skinned


@pytest.mark.parametrize("path", ["/Root", "/Root/Geo"])
def test_joints_that_pose_nothing_are_told(tmp_path: Path, path: str) -> None:
    """Without a SkelRoot, and below a prim without a type, UsdSkel skins nothing."""
    stage = skinned_stage(tmp_path / "in.usda")
    assert not only_mesh(tmp_path / "in.usda").warnings
    if path == "/Root":
        stage.GetPrimAtPath(path).SetTypeName("Xform")
    else:
        layer = stage.GetRootLayer()
        Sdf.CreatePrimInLayer(layer, path).specifier = Sdf.SpecifierDef
        assert Sdf.CopySpec(layer, "/Root/A", layer, "/Root/Geo/A")
        stage.RemovePrim("/Root/A")
    stage.GetRootLayer().Save()
    mesh = only_mesh(tmp_path / "in.usda")
    (told,) = mesh.warnings
    assert not mesh.skinned and "nothing poses it" in told


def test_blocked_base_points_stay_blocked(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "in.usda")
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/A")).GetPointsAttr()
    points.Set(vec3f(BOX), 0.0)
    points.Set(Sdf.ValueBlock(), 20.0)
    stage.GetRootLayer().Save()
    mesh = only_mesh(tmp_path / "in.usda")
    assert read_frame(mesh, 25.0) is None
    np.testing.assert_allclose(present(read_frame(mesh, 15.0)), bent(45.0), atol=2e-6)


def test_a_stage_without_skeletons_has_no_skins(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage)
    stage.GetRootLayer().Save()
    assert only_mesh(tmp_path / "in.usda").skin is None


@pytest.mark.parametrize("above", [False, True])
def test_skins_in_instances_are_posed(tmp_path: Path, above: bool) -> None:
    """The root of the skeleton may be the instance itself, whose children are proxies then."""
    skinned_file(tmp_path / "asset.usda")
    stage = new_stage(tmp_path / "a.usda")
    define_cube(stage, "/Plain")
    crowd = stage.DefinePrim("/Crowd")
    instance = crowd if above else stage.DefinePrim("/Crowd/One")
    asset = stage.DefinePrim("/Crowd/One/Hero") if above else instance
    asset.GetReferences().AddReference("./asset.usda", "/Root")
    if above:
        inner = Usd.Stage.CreateNew(str(tmp_path / "inner.usda"))
        inner.DefinePrim("/Set/Hero").GetReferences().AddReference("./asset.usda", "/Root")
        inner.Save()
        stage.RemovePrim("/Crowd/One")
        instance.GetReferences().AddReference("./inner.usda", "/Set")
    instance.SetInstanceable(True)
    stage.GetRootLayer().Save()
    plain = only_mesh(tmp_path / "asset.usda")
    found = read_meshes(open_stage(tmp_path / "a.usda"), instances=True).meshes
    (mesh,) = [own for own in found if own.instanced]
    assert mesh.skinned and mesh.times.tolist() == plain.times.tolist()
    for time in (0.0, 15.0, 30.0):
        assert np.array_equal(present(read_frame(mesh, time)), present(read_frame(plain, time)))
