"""What stands still beside a body that bends is of the set around, unless it is a part of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pxr import Sdf

from dtrepair.numerics.geometry import IntArray
from dtrepair.pipeline import RepairSettings, repair_stage
from dtrepair.pipeline.modelled.meshes import PlacedMeshes
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.object_settings import read_settings
from dtrepair.pipeline.stages.rest import choose_rests
from dtrepair.pipeline.stages.shot.sets import find_sets
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.pipeline.transfer.inputs import open_poses
from tests.command_line import read_samples, run
from tests.meshes import Mesh, elbow, icosphere, torus

TIMES = [1.0, 2.0, 3.0]
BODY, CHAIR = "/Shot/Girl/Body", "/Shot/Set/Chair"


BENDS = (0.1, 0.5, 1.0)
FACES = elbow(0.1)[1]
BOX = icosphere(1, 0.3)


def placed(mesh: Mesh, *where: float) -> Mesh:
    """A mesh elsewhere."""
    return mesh[0] + np.array(where), mesh[1]


def stage_of(
    path: Path,
    *still: tuple[str, Mesh],
    bends: Sequence[float] = BENDS,
    faces: IntArray = FACES,
    skirt: str = "/Shot/Girl/Skirt",
) -> Path:
    """An arm that bends, a band of its own that goes along, and what stands still beside it."""
    from usd_io import AuthoredMesh, write_animation

    poses = [elbow(bend)[0].astype(np.float32) for bend in bends]
    band = [1.5 * (pose[:3] - pose[:12].mean(axis=0)) + pose[:12].mean(axis=0) for pose in poses]
    meshes = [
        AuthoredMesh(path=BODY, faces=faces, rest=poses[0], points=poses),
        AuthoredMesh(path=skirt, faces=np.array([[0, 1, 2]]), rest=band[0], points=band),
    ]
    for name, (points, own) in still:
        meshes.append(AuthoredMesh(path=name, faces=own, rest=points.astype(np.float32)))
    write_animation(path, meshes, times=TIMES)
    return path


def sets_of(path: Path) -> list[str]:
    source = open_source(str(path), Selection())
    find_sets(source, read_settings(source).each)
    return [mesh.path for mesh in source.meshes if mesh.of_set]


def test_a_chair_is_of_the_set_where_it_is_in_a_group_of_its_own(tmp_path: Path) -> None:
    """It meets the body in all frames, and so may be a part of it if nothing tells them apart."""
    chair = placed(BOX, 0.4, 0.0, 0.0)
    assert sets_of(stage_of(tmp_path / "a.usda", (CHAIR, chair))) == [CHAIR]
    assert sets_of(stage_of(tmp_path / "b.usda", ("/Shot/Girl/Shoe", chair))) == []
    # Where a group is one mesh they may be the parts of one character.
    single = stage_of(tmp_path / "c.usda", (CHAIR, chair), skirt="/Shot/Skirt/Mesh")
    assert sets_of(single) == []


def test_what_is_far_from_the_body_is_none(tmp_path: Path) -> None:
    for far, expected in ((0.6, [CHAIR]), (0.9, []), (9.0, [])):
        path = stage_of(tmp_path / f"{far}.usda", (CHAIR, placed(BOX, far, 0.0, 0.0)))
        assert sets_of(path) == expected


def test_only_beside_what_bends_and_is_closed(tmp_path: Path) -> None:
    chair = (CHAIR, placed(BOX, 0.4, 0.0, 0.0))
    assert sets_of(stage_of(tmp_path / "a.usda", chair, bends=(0.5, 0.5, 0.5))) == []
    sleeve = FACES[: len(FACES) // 2]
    assert sets_of(stage_of(tmp_path / "b.usda", chair, faces=sleeve)) == []
    # A small closed part, as a button, makes no body of a garment.
    button = np.concatenate([sleeve, FACES[-12:]])
    assert sets_of(stage_of(tmp_path / "c.usda", chair, faces=button)) == []
    for middle in (0.1, 1.0):
        assert sets_of(stage_of(tmp_path / "d.usda", chair, bends=(0.1, middle, 0.1))) == (
            [CHAIR] if middle == 1.0 else []
        )


def test_a_collider_that_is_named_is_no_furniture(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda", (CHAIR, placed(BOX, 0.4, 0.0, 0.0)))
    source = open_source(str(path), Selection(), collider=CHAIR)
    find_sets(source, read_settings(source).each)
    known = {mesh.path: (mesh.collider, mesh.of_set) for mesh in source.meshes}
    assert known[CHAIR] == (True, False)


def test_what_lies_in_the_body_is_a_part_of_it(tmp_path: Path) -> None:
    eye = placed(icosphere(1, 0.05), *elbow(0.1)[0][:12].mean(axis=0))
    ring = (torus(24, 8, 0.25, 0.04)[0] + elbow(0.1)[0][60:72].mean(axis=0), torus(24, 8)[1])
    for name, part in (("eye", eye), ("ring", ring)):
        still = [(f"/Shot/{name}/{side}", part) for side in ("a", "b")]
        assert sets_of(stage_of(tmp_path / f"{name}.usda", *still)) == []


def test_a_body_gives_way_to_a_chair_that_keeps_every_bit(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda", (CHAIR, placed(icosphere(2, 0.3), 0.0, 0.4, 0.3)))
    out = tmp_path / "b.usda"
    report = repair_stage(str(path), str(out), RepairSettings())
    assert all(own.before and own.before.pairs for own in report.frames)
    assert [own.status for own in report.frames] == ["clean"] * 3
    layer = Sdf.Layer.FindOrOpen(str(out))
    assert layer.GetPrimAtPath(BODY) and not layer.GetPrimAtPath(CHAIR)


def test_an_instance_is_left_as_it_is_and_what_meets_it_gives_way(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    chair = ("/Chair/Mesh", placed(icosphere(2, 0.3), 0.0, 0.4, 0.3))
    path = stage_of(tmp_path / "a.usda", chair, skirt="/Shot/Skirt/Mesh")
    stage = Usd.Stage.Open(str(path))
    instance = UsdGeom.Xform.Define(stage, "/Shot/Girl/Instance").GetPrim()
    instance.GetReferences().AddInternalReference("/Chair")
    instance.SetInstanceable(True)
    stage.GetPrimAtPath("/Chair").SetSpecifier(Sdf.SpecifierClass)
    stage.Save()
    out = run("repair", path, "-o", tmp_path / "b.usda")
    assert out.code == 0 and "/Shot/Girl/Instance/Mesh: lies in the instance" in out.err
    moved = [read_samples(own, BODY) for own in (path, tmp_path / "b.usda")]
    assert all((moved[0][time] != moved[1][time]).any() for time in TIMES)
    # It may be named, as what it is; and poses are read of it.
    there = ("--collider", "/Shot/Girl/Instance//", "--dry-run")
    assert run("repair", path, "-o", tmp_path / "c.usda", *there).code == 0
    only = run("repair", path, "-o", tmp_path / "c.usda", "--prim", "/Shot/Girl/Instance//")
    assert (
        only.code == 3 and "nothing may change" in only.err and "--uninstance lets it" in only.err
    )
    shapes = run("repair", path, "-o", tmp_path / "c.usda", "--prim", "/Shot/G*/I*//", "--delta")
    assert shapes.code == 3 and "nothing may change" in shapes.err
    looked = run("check", path, "--prim", "/Shot/Girl/Instance//")
    assert looked.code == 0 and "no intersections" in looked.out
    assert not any(mesh.collider for mesh in open_poses(str(path), (), Selection()).meshes)
    # What meets it may be attached to it, not so what meets a thing that was named.
    for named, told in ((None, False), (BODY, True)):
        source = open_source(str(path), Selection(), collider=named)
        meshes = PlacedMeshes(source, choose_rests(source, None, device="cpu"))
        paths = [mesh.path for mesh in source.meshes]
        sides = [paths.index(own) for own in (BODY, "/Shot/Girl/Instance/Mesh")]
        pair = np.array([[np.argmax(meshes.mesh_of == own) for own in sides]])
        assert meshes.collide(pair).tolist() == [told]
