"""`dtrepair repair` with several meshes and colliders."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair.report.record import read_report
from tests.command_line import (
    CLOSED,
    OPEN,
    read_samples,
    run,
    tube_polygons,
    tube_stage,
)
from tests.meshes import icosphere, tube_quads


@pytest.fixture
def rod_in_ball(tmp_path: Path) -> Path:
    """A rod that a transform moves into a ball; both live under scaled or turned parents."""
    from usd_io import AuthoredMesh, write_animation

    ball, ball_faces = icosphere(2, radius=0.5)
    rod, rod_faces = tube_quads(8, 12, radius=0.12, length=1.2)
    into = np.tile(np.diag([10.0, 10.0, 10.0, 1.0]), (4, 1, 1))
    into[:, 3, 2] = (20.0, 10.5, 9.0, 20.0)
    turn = np.array([[0, 20.0, 0, 0], [-20.0, 0, 0, 0], [0, 0, 20.0, 0], [0, 0, 0, 1]])
    path = tmp_path / "scene.usda"
    meshes = [
        AuthoredMesh(path="/Ball/Mesh", faces=ball_faces, rest=ball, transforms=turn),
        AuthoredMesh(path="/Rod/Mesh", faces=rod_faces, rest=rod, transforms=into),
    ]
    write_animation(path, meshes, times=(1.0, 2.0, 3.0, 4.0))
    return path


def moved(path: Path, out: Path, prim: str) -> list[bool]:
    """Whether a mesh's points differ from the input's at each time code that was written."""
    from pxr import Usd

    values = []
    for name in (path, out):
        stage = Usd.Stage.Open(str(name))  # prims die with their stage
        attribute = stage.GetPrimAtPath(prim).GetAttribute("points")
        values.append([np.array(attribute.Get(time)) for time in (1, 2, 3, 4)])
    return [not np.array_equal(a, b) for a, b in zip(*values, strict=True)]


def test_two_meshes_are_separated_in_world_space(rod_in_ball: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usdc"
    report = tmp_path / "r.json"
    assert run("check", rod_in_ball).code == 1
    done = run("repair", rod_in_ball, "-o", out, "--report", report, "--alone")
    assert done.code == 0, done
    assert run("check", out).code == 0
    frames = read_report(report)["frames"]
    assert [frame["before"]["inter_pairs"] > 0 for frame in frames] == [False, True, True, False]
    assert [frame["after"]["pairs"] for frame in frames] == [0, 0, 0, 0]
    assert {prim["path"] for prim in frames[1]["prims"]} == {"/Ball/Mesh", "/Rod/Mesh"}
    assert moved(rod_in_ball, out, "/Ball/Mesh") == [False, True, True, False]
    assert moved(rod_in_ball, out, "/Rod/Mesh") == [False, True, True, False]


@pytest.fixture
def different_ranges(tmp_path: Path) -> Path:
    """A ball squashed at times 1 to 4, a rod that goes right through it at 3, 5, 7 and 9."""
    from pxr import Usd

    from usd_io import AuthoredMesh, write_animation

    ball, ball_faces = icosphere(2, radius=0.5)
    rod, rod_faces = icosphere(2)
    rod = rod * np.array([0.1, 0.1, 1.2])
    times = np.arange(1.0, 10.0)
    squash = np.interp(times, [1, 2, 3, 4], [1.0, 1.2, 0.9, 1.0])
    height = np.interp(times, [3, 9], [2.0, 0.1])
    path = np.tile(np.eye(4), (len(times), 1, 1))
    path[:, 3] = [(0.15, 0.1, z, 1.0) for z in height]
    meshes = [
        AuthoredMesh(
            path="/Ball/Mesh", faces=ball_faces, points=[ball * [1, 1, s] for s in squash]
        ),
        AuthoredMesh(path="/Rod/Mesh", faces=rod_faces, rest=rod, transforms=path),
    ]
    file = tmp_path / "ranges.usda"
    write_animation(file, meshes, times=times)
    stage = Usd.Stage.Open(str(file))
    points = stage.GetPrimAtPath("/Ball/Mesh").GetAttribute("points")
    matrices = stage.GetPrimAtPath("/Rod").GetAttribute("xformOp:transform")
    for time in times:
        if time > 4:
            points.ClearAtTime(time)
        if time not in (3, 5, 7, 9):
            matrices.ClearAtTime(time)
    stage.Save()
    return file


@pytest.mark.parametrize("still", [None, "/Ball//", "/Rod//"])
def test_different_frame_ranges_of_two_animated_meshes(
    different_ranges: Path, tmp_path: Path, still: str | None
) -> None:
    out, report = tmp_path / "out.usda", tmp_path / "r.json"
    options = ["--collider", still] if still else []
    assert run("check", different_ranges).code == 1
    done = run("repair", different_ranges, "-o", out, "--report", report, *options)
    assert done.code == run("check", out).code == 0, done
    frames = read_report(report)["frames"]
    assert [frame["time"] for frame in frames] == [1, 2, 3, 4, 5, 6, 7, 8, 9]
    for frame in frames:
        # A rod right through a ball is moved, not stretched.
        for prim in frame["prims"]:
            motion = prim["motion"]
            assert motion is None or motion["edge_change"] < 0.02
            assert motion is None or still is None or not prim["path"].startswith(still[:-2])
    assert frames[-1]["before"]["inter_pairs"] > 20


def test_meshes_that_never_lie_clear_of_each_other_are_named(
    rod_in_ball: Path, tmp_path: Path
) -> None:
    out = ("-o", tmp_path / "out.usda")
    told = "intersect in their rest poses, wherever the clip places these: "
    # Frame 1 tells, even if it is not selected.
    assert told not in run("repair", rod_in_ball, *out, "--frames", "2:3").err
    still = sink(rod_in_ball, tmp_path)
    cures = "name a frame in which they do not with --rest FRAME, or say with --layer "
    assert f"/Ball/Mesh and /Rod/Mesh {told}{cures}" in run("repair", still, *out).err
    assert told not in run("repair", still, *out, "--mode", "self").err
    assert told not in run("repair", still, *out, "--ignore", "/Ball,/Rod").err
    # Whoever says which is outside need not hear that nothing does; equal numbers say nothing.
    layer, equal = ("--layer", "/Ball=2"), ("--layer", "/Rod=2")
    assert told not in run("repair", still, *out, *layer).err
    assert told in run("repair", still, *out, *layer, *equal).err
    # What the user calls attached is no layer over the other, and is told as such.
    attached = run("repair", still, *out, "--attach", "/Ball,/Rod").err
    assert told not in attached and "taken as modelled: 1 pair of parts" in attached


def sink(path: Path, folder: Path) -> Path:
    """The scene with the rod in the ball at every time."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    matrices = stage.GetPrimAtPath("/Rod").GetAttribute("xformOp:transform")
    for time in (1, 4):
        matrices.Set(matrices.Get(3), time)
    other = folder / "sunk.usda"
    stage.Export(str(other))
    return other


def test_frames_not_selected_stay_as_they_are(rod_in_ball: Path, tmp_path: Path) -> None:
    # The points of both have no time samples, and the transform of the ball has none either.
    out = tmp_path / "out.usda"
    assert run("repair", rod_in_ball, "-o", out, "--frames", "2", "--alone").code == 0
    assert moved(rod_in_ball, out, "/Ball/Mesh") == [False, True, False, False]
    assert moved(rod_in_ball, out, "/Rod/Mesh") == [False, True, False, False]


def test_two_meshes_steadily(rod_in_ball: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usdc"
    done = run("repair", rod_in_ball, "-o", out)
    assert done.code == run("check", out).code == 0, done


@pytest.mark.parametrize(
    ("still", "other"), [("/Ball/Mesh", "/Rod/Mesh"), ("/Rod/Mesh", "/Ball/Mesh")]
)
def test_a_collider_never_moves(rod_in_ball: Path, tmp_path: Path, still: str, other: str) -> None:
    out = tmp_path / "out.usda"
    done = run("repair", rod_in_ball, "-o", out, "--prim", other, "--collider", still)
    assert done.code == run("check", out).code == 0, done
    assert not any(moved(rod_in_ball, out, still))
    assert any(moved(rod_in_ball, out, other))
    # The collider is not even in the layer.
    assert still.split("/")[1] not in out.read_text().split("subLayers")[1]


@pytest.mark.parametrize(("loose", "told"), [(0, "is empty"), (4, "has no faces"), (-1, "points")])
def test_a_mesh_without_anything_beside_others_is_left(
    rod_in_ball: Path, tmp_path: Path, loose: int, told: str
) -> None:
    """loose: its vertices, none of which is in a face; -1: not even the attributes are there."""
    from pxr import Sdf, Usd, UsdGeom, Vt

    alone, out = tmp_path / "alone.usda", tmp_path / "out.usda"
    assert run("repair", rod_in_ball, "-o", alone).code == 0
    stage = Usd.Stage.Open(str(rod_in_ball))
    mesh = UsdGeom.Mesh.Define(stage, "/Ball/Empty")
    if loose >= 0:
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray())
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray())
        for time in (Usd.TimeCode.Default(), 1.0, 2.0):
            mesh.GetPointsAttr().Set(Vt.Vec3fArray(loose), time)
    stage.Save()
    given = rod_in_ball.read_bytes()
    done = run("repair", rod_in_ball, "-o", out)
    assert done.code == 0 and given == rod_in_ball.read_bytes()
    (line,) = (line for line in done.err.splitlines() if "/Ball/Empty" in line)
    assert "warning" in line and told in line and line.endswith("skipped")
    assert not Sdf.Layer.FindOrOpen(str(out)).GetPrimAtPath("/Ball/Empty")
    for prim in ("/Ball/Mesh", "/Rod/Mesh"):
        ours, theirs = (read_samples(path, prim) for path in (out, alone))
        assert ours.keys() == theirs.keys()
        assert all(np.array_equal(ours[time], theirs[time]) for time in ours)


def test_mode_self_leaves_contacts_between_meshes(rod_in_ball: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usda"
    assert run("repair", rod_in_ball, "-o", out, "--mode", "self").code == 0
    assert not any(moved(rod_in_ball, out, "/Rod/Mesh"))
    assert run("check", out).code == 1


def test_a_mesh_that_holds_its_points_stays_put_between_its_samples(tmp_path: Path) -> None:
    """A mesh keyed at 1 and 5 beside one keyed at every frame: clean frames must not shift."""
    from pxr import Usd

    from usd_io import AuthoredMesh, write_animation

    path = tube_stage(tmp_path / "tube.usda", (OPEN, OPEN, CLOSED, OPEN, OPEN))
    ball, faces = icosphere(1, radius=0.1)
    points = [ball + np.array([5, 0, 0.1 * time]) for time in range(5)]
    meshes = [
        AuthoredMesh(
            path="/Root/Tube",
            faces=tube_polygons(),
            points=list(read_samples(path).values()),
        ),
        AuthoredMesh(path="/Root/Ball", faces=faces, points=points),
    ]
    both = tmp_path / "both.usda"
    write_animation(both, meshes, times=np.arange(1.0, 6.0))
    stage = Usd.Stage.Open(str(both))
    attribute = stage.GetPrimAtPath("/Root/Tube").GetAttribute("points")
    for time in (2, 4):
        attribute.ClearAtTime(time)
    stage.Save()
    held = {time: np.array(attribute.Get(time)) for time in (1, 2, 4, 5)}
    del attribute, stage
    out = tmp_path / "out.usdc"
    assert run("repair", both, "-o", out, "--alone").code == 0
    stage = Usd.Stage.Open(str(out))
    result = stage.GetPrimAtPath("/Root/Tube").GetAttribute("points")
    for time, expected in held.items():
        assert np.allclose(np.array(result.Get(time)), expected, atol=1e-6)
