"""The set around a shot is found, never moves, and is told of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.pipeline import ObjectOptions, RepairSettings, SetsFound, repair_stage
from dtrepair.pipeline.modelled.references import ReferenceOptions
from dtrepair.pipeline.observer import Observer, Remark
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.bodies import make_bodies, read_controls
from dtrepair.pipeline.stages.object_settings import read_settings
from dtrepair.pipeline.stages.rest import choose_rests
from dtrepair.pipeline.stages.shot.sets import find_sets, pairs_beside
from dtrepair.pipeline.stages.sources import open_source
from tests.command_line import read_samples, run
from tests.meshes import icosphere
from tests.rigged_tube import MESH, rigged_tube

BALL, FACES = icosphere(2)
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
TIMES = [1.0, 2.0, 3.0]
ALONG, UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


class Heard(Observer):
    """Remembers remarks."""

    def __init__(self) -> None:
        self.remarks: list[Remark] = []

    def remark(self, remark: Remark) -> None:
        self.remarks.append(remark)

    @property
    def sets(self) -> list[tuple[str, ...]]:
        return [own.paths for own in self.remarks if isinstance(own, SetsFound)]


def stage_of(
    path: Path,
    *,
    half: float = 50.0,
    depth: float = 0.05,
    moves: bool = True,
    halves: NDArray[np.int64] = HALVES,
) -> Path:
    """A ball that rolls on a square floor with half a side, so deep in it; a wall through that.

    halves: the triangles (2, 3) of both.
    """
    from usd_io import AuthoredMesh, write_animation

    ball = BALL + (1.0 - depth) * UP
    steps = np.linspace(0.0, 0.5, 3) if moves else np.zeros(1)
    poses = [(ball + x * ALONG).astype(np.float32) for x in steps]
    floor = (half * SQUARE).astype(np.float32)
    wall = floor[:, [0, 2, 1]] + 0.5 * half * UP[[0, 2, 1]].astype(np.float32)
    meshes = [
        AuthoredMesh(
            path="/Ball/Mesh", faces=FACES, rest=poses[0], points=poses if moves else None
        ),
        AuthoredMesh(path="/Set/Floor", faces=halves, rest=floor),
        AuthoredMesh(path="/Set/Wall", faces=halves, rest=wall),
    ]
    write_animation(path, meshes, times=TIMES if moves else ())
    return path


def half_as_free(path: Path, prim: str) -> None:
    """Give a mesh of a stage a mobility of its own."""
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(prim))
    assert primvars.CreatePrimvar("dtrepair:mobility", Sdf.ValueTypeNames.Float).Set(0.5)
    stage.Save()


def sets_of(path: Path) -> list[str]:
    source = open_source(str(path), Selection())
    find_sets(source, read_settings(source).each)
    found = [mesh for mesh in source.meshes if mesh.of_set]
    assert all(mesh.collider for mesh in found)
    return [mesh.path for mesh in found]


@pytest.mark.parametrize(
    ("half", "moves", "expected"),
    [(50.0, True, ["/Set/Floor", "/Set/Wall"]), (1.2, True, []), (50.0, False, [])],
)
def test_what_stands_still_and_is_large_is_of_the_set(
    tmp_path: Path, half: float, moves: bool, expected: list[str]
) -> None:
    assert sets_of(stage_of(tmp_path / "a.usda", half=half, moves=moves)) == expected


def test_what_is_flat_is_a_set_sooner_than_what_is_not(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom, Vt

    path = stage_of(tmp_path / "a.usda", half=1.5)
    assert sets_of(path) == ["/Set/Floor", "/Set/Wall"]
    stage = Usd.Stage.Open(str(path))
    wall = UsdGeom.Mesh(stage.GetPrimAtPath("/Set/Wall"))
    for half, expected in ((1.5, []), (2.2, ["/Set/Wall"])):
        wall.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy((half * BALL).astype(np.float32)))
        wall.GetFaceVertexIndicesAttr().Set(FACES.ravel().tolist())
        wall.GetFaceVertexCountsAttr().Set([3] * len(FACES))
        stage.Save()
        assert sets_of(path) == ["/Set/Floor", *expected]


def test_how_freely_a_thing_moves_does_not_change_what_is_a_set(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda")
    half_as_free(path, "/Ball/Mesh")
    assert sets_of(path) == ["/Set/Floor", "/Set/Wall"]


def test_a_check_of_some_meshes_takes_a_config_for_all(tmp_path: Path) -> None:
    path, config = stage_of(tmp_path / "a.usda"), tmp_path / "a.toml"
    config.write_text('[[prim]]\npath = "/Set/Floor"\nmobility = 1.0\n')
    assert run("check", path, "--prim", "/Ball//", "--config", config).code == 0


@pytest.mark.parametrize("skinned", [False, True])
def test_a_character_that_stands_still_is_no_set(tmp_path: Path, skinned: bool) -> None:
    from pxr import Usd, UsdGeom, UsdSkel, Vt

    path = rigged_tube(tmp_path / "a.usda", (20.0,))
    stage = Usd.Stage.Open(str(path))
    if not skinned:
        stage.GetPrimAtPath(MESH).RemoveAPI(UsdSkel.BindingAPI)
    fly = UsdGeom.Mesh.Define(stage, "/Fly")
    fly.CreateFaceVertexCountsAttr([3] * len(FACES))
    fly.CreateFaceVertexIndicesAttr(FACES.ravel().tolist())
    for time in TIMES:
        points = (0.1 * BALL + time).astype(np.float32)
        fly.CreatePointsAttr().Set(Vt.Vec3fArray.FromNumpy(points), time)
    stage.Save()
    assert sets_of(path) == ([] if skinned else [MESH])


def test_a_set_keeps_its_bits_and_what_it_meets_gives_way(tmp_path: Path) -> None:
    path, out, heard = stage_of(tmp_path / "a.usda"), tmp_path / "b.usdc", Heard()
    report = repair_stage(str(path), str(out), RepairSettings(), observer=heard)
    assert heard.sets == [("/Set/Floor", "/Set/Wall")]
    assert [frame.status for frame in report.frames] == ["clean"] * 3
    assert all(frame.before is not None and frame.before.pairs for frame in report.frames)
    moved = [read_samples(name, "/Ball/Mesh") for name in (path, out)]
    assert all((moved[1][time] != moved[0][time]).any() for time in TIMES)
    from pxr import Sdf

    layer = Sdf.Layer.FindOrOpen(str(out))
    assert layer.GetPrimAtPath("/Ball/Mesh") and not layer.GetPrimAtPath("/Set/Floor")
    assert not any("collider" in warning for warning in report.warnings)


def test_a_mobility_of_its_own_lets_a_set_give_way(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda")
    half_as_free(path, "/Set/Floor")
    source = open_source(str(path), Selection())
    controls = read_controls(source, ObjectOptions())
    bodies = make_bodies(source, choose_rests(source, None, device="cpu"), controls).bodies
    assert [body.mobility for body in bodies] == [1.0, 0.5, 0.0]
    assert controls.ignored == ((2, 2),)


def test_contacts_within_a_set_are_told_by_a_strict_check_only(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda", depth=-0.05)
    usual = run("check", path, "--json", "-")
    assert usual.json["summary"]["pairs_before"] == 0 and "set that does not move" in usual.err
    strict = run("check", path, "--strict", "--json", "-")
    assert strict.json["summary"]["pairs_before"] > 0


def test_a_mesh_that_meets_itself_is_told_by_a_check_though_it_stands_still(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    path = stage_of(tmp_path / "a.usda", depth=-0.05)
    stage = Usd.Stage.Open(str(path))
    floor = UsdGeom.Mesh(stage.GetPrimAtPath("/Set/Floor"))
    points = np.concatenate([50.0 * SQUARE, 50.0 * SQUARE[:, [0, 2, 1]]]).astype(np.float32)
    floor.GetPointsAttr().Set(points)
    floor.GetFaceVertexCountsAttr().Set([3] * 4)
    floor.GetFaceVertexIndicesAttr().Set(np.concatenate([HALVES, HALVES + 4]).ravel().tolist())
    stage.Save()
    found = run("check", path, "--json", "-")
    assert found.code == 1 and found.json["summary"]["pairs_before"] > 0
    assert (
        "colliders that intersect themselves"
        in run("repair", path, "-o", path.with_suffix(".usdc")).err
    )


@pytest.mark.parametrize("frames", [4, 6])
def test_parts_of_a_set_that_meet_were_modelled_so_where_frames_tell(
    frames: int, tmp_path: Path
) -> None:
    """As the legs of a chair in its seat: a repair does not count them either."""
    from usd_io import AuthoredMesh, write_animation

    poses = [(BALL + x * ALONG).astype(np.float32) for x in np.linspace(0.0, 0.5, frames)]
    crossed = np.concatenate([9.0 * SQUARE, 9.0 * SQUARE[:, [0, 2, 1]]]) - 11.0 * UP
    chair = crossed.astype(np.float32), np.concatenate([HALVES, HALVES + 4])
    meshes = [
        AuthoredMesh(path="/Ball/Mesh", faces=FACES, rest=poses[0], points=poses),
        AuthoredMesh(path="/Set/Chair", faces=chair[1], rest=chair[0]),
    ]
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=np.arange(frames).astype(float))
    found = run("check", path, "--json", "-")
    assert "set that does not move: /Set/Chair" in found.err
    counts = found.json["summary"]
    told = frames >= ReferenceOptions().least
    assert (counts["pairs_before"] == 0) == (counts["modelled_pairs_before"] > 0) == told
    assert found.code == (0 if told else 1)
    assert ("/Set/Chair part 1 with /Set/Chair part 2" in found.err) == told
    repaired = run("repair", path, "-o", tmp_path / "b.usdc", "--report", "-")
    assert repaired.json["summary"]["pairs_before"] == 0


@pytest.mark.parametrize("at", TIMES)
def test_what_is_hidden_by_its_scale_for_a_time_makes_nothing_a_set(
    tmp_path: Path, at: float
) -> None:
    from pxr import Gf, Usd, UsdGeom

    path = stage_of(tmp_path / "a.usda", half=1.2)
    stage = Usd.Stage.Open(str(path))
    scale = UsdGeom.Xformable(stage.GetPrimAtPath("/Ball/Mesh")).AddScaleOp()
    for time in TIMES:
        scale.Set(Gf.Vec3f(1e-4 if time == at else 1.0), time)
    stage.Save()
    assert sets_of(path) == []


def test_a_collider_that_is_named_is_no_set(tmp_path: Path) -> None:
    path = stage_of(tmp_path / "a.usda")
    source = open_source(str(path), Selection(), collider="/Set/Floor")
    read_controls(source, ObjectOptions())
    assert [(m.collider, m.of_set, m.faces_away is not None) for m in source.meshes] == [
        (False, False, False),
        (True, False, True),
        (True, True, True),
    ]


@pytest.mark.parametrize(("thin", "expected"), [(0.05, ["/Set/Floor"]), (1.5, [])])
def test_what_is_flat_is_so_in_the_world(tmp_path: Path, thin: float, expected: list[str]) -> None:
    from pxr import Gf, Usd, UsdGeom, Vt

    path = stage_of(tmp_path / "a.usda", half=1.2)
    stage = Usd.Stage.Open(str(path))
    floor = UsdGeom.Mesh(stage.GetPrimAtPath("/Set/Floor"))
    floor.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(BALL.astype(np.float32)))
    floor.GetFaceVertexIndicesAttr().Set(FACES.ravel().tolist())
    floor.GetFaceVertexCountsAttr().Set([3] * len(FACES))
    UsdGeom.Xformable(floor).AddScaleOp().Set(Gf.Vec3f(1.5, 1.5, thin))
    stage.Save()
    assert sets_of(path) == expected


def test_a_frame_beyond_all_numbers_tells_nothing_of_sets(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom, Vt

    path = stage_of(tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(path))
    ball = UsdGeom.Mesh(stage.GetPrimAtPath("/Ball/Mesh"))
    UsdGeom.Xformable(ball).AddScaleOp().Set((10.0, 10.0, 10.0))
    ball.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy((5e37 * BALL).astype(np.float32)), TIMES[-1])
    stage.Save()
    assert sets_of(path) == ["/Set/Floor", "/Set/Wall"]


def test_meshes_are_beside_each_other_if_they_are_so_in_any_frame(tmp_path: Path) -> None:
    from usd_io import AuthoredMesh, write_animation

    times = np.arange(9.0)
    away = np.where(np.isin(times, (0.0, 4.0, 8.0)), 5.0, 0.5)
    meshes = [
        AuthoredMesh(
            path=f"/Ball{k}/Mesh",
            faces=FACES,
            rest=BALL.astype(np.float32),
            points=[(BALL + k * x * ALONG).astype(np.float32) for x in away],
        )
        for k in (0, 1, 20)
    ]
    write_animation(tmp_path / "a.usda", meshes, times=times.tolist())
    source = open_source(str(tmp_path / "a.usda"), Selection())
    assert pairs_beside(source, [(0, 1), (0, 2), (1, 2)]) == [(0, 1)]
    assert pairs_beside(source, []) == []


def test_in_a_single_pose_what_has_none_of_its_own_is_of_the_set(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom, Vt

    path = stage_of(tmp_path / "a.usda", half=2.0, moves=False)
    assert sets_of(path) == []
    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Ball/Mesh")).GetPointsAttr()
    rest = np.array(points.Get())
    points.Set(Vt.Vec3fArray.FromNumpy(rest), 1.0)
    stage.Save()
    assert sets_of(path) == []  # the same: it may stand as well
    points.Set(Vt.Vec3fArray.FromNumpy(rest + ALONG.astype(np.float32)), 1.0)
    stage.Save()
    assert sets_of(path) == ["/Set/Floor", "/Set/Wall"]


def test_nobody_asks_whether_what_stands_on_a_set_was_modelled_so(tmp_path: Path) -> None:
    for half, asked in ((50.0, False), (1.2, True)):
        path = stage_of(tmp_path / f"{asked}.usda", half=half)
        found = run("check", path).err
        assert ("nothing tells whether they were modelled so" in found) == asked
