"""`dtrepair check`: exact counts, exit codes, and what it prints."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.report.schema import validate
from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_obj, tube_stage


def test_mesh_file_with_intersections(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "a.obj", CLOSED)
    found = run("check", path)
    assert found.code == 1 and found.err == ""
    assert found.out.splitlines()[0].split() == ["frame", "triangles", "pairs"]
    assert found.out.splitlines()[-1].startswith("1 of 1 frame intersects: ")


def test_clean_mesh_file(tmp_path: Path) -> None:
    found = run("check", tube_obj(tmp_path / "a.obj", OPEN))
    assert found.code == 0
    assert found.out.splitlines()[-1] == "no intersections in 1 frame"


def test_counts_agree_with_the_library(tmp_path: Path) -> None:
    from dtrepair import find_intersections
    from tests.command_line import tube_polygons, tube_pose
    from tests.meshes import split_quads

    pairs = find_intersections(tube_pose(CLOSED), split_quads(tube_polygons()))
    report = run("check", tube_obj(tmp_path / "a.obj", CLOSED), "--json", "-").json
    validate(report)
    assert report["frames"][0]["before"] == {
        "triangles": len(np.unique(pairs)),
        "pairs": len(pairs),
        "inter_pairs": 0,
        "modelled_triangles": 0,
        "modelled_pairs": 0,
    }
    assert report["frames"][0]["time"] is None
    assert report["prims"][0] == {
        "path": "a.obj",
        "vertices": 200,
        "triangles": 384,
        "rest_intersections": None,
    }


def test_reports_go_to_several_files(tmp_path: Path) -> None:
    path, places = tube_obj(tmp_path / "a.obj", CLOSED), [tmp_path / "r.json", tmp_path / "r.html"]
    found = run("check", path, *(word for place in places for word in ("--report", place)))
    assert found.code == 1
    validate(json.loads(places[0].read_text()))
    assert "<html" in places[1].read_text()
    both = run("check", path, "--report", "-", "--report", places[0])
    assert json.loads(both.out) == {**json.loads(places[0].read_text()), **both.json}
    for place in (places[0], "-"):
        again = run("check", path, "--report", place, "--report", place)
        assert_fails(again, 2, "--report" if place == "-" else "r.json")


def test_stage_counts_each_frame(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN), times=(-2, 0.5, 7))
    found = run("check", path, "--samples", "--json", tmp_path / "r.json")
    assert found.code == 1
    rows = [line.split() for line in found.out.splitlines()[1:-1]]
    assert [row[0] for row in rows] == ["-2", "0.5", "7"]
    assert [int(row[1]) > 0 for row in rows] == [False, True, False]
    report = json.loads((tmp_path / "r.json").read_text())
    validate(report)
    assert [frame["time"] for frame in report["frames"]] == [-2, 0.5, 7]
    assert [frame["status"] for frame in report["frames"]] == ["clean", "unchanged", "clean"]


def test_frames_beyond_the_stage_are_told(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN, CLOSED))
    done = run("check", path, "--frames", "1:6")
    assert "frames '1:6' go beyond those of the stage, 1 to 4; what is beyond is left" in done.err
    assert "2 of 4 frames intersect" in done.out
    for inside in ("1:4", "4:1x-2", "2", "1:3x0.5"):
        assert run("check", path, "--frames", inside).err == ""
    assert "go beyond" in run("check", path, "--frames", "0,2").err


def test_frames_and_quiet(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    assert run("check", path, "--frames", "1:3x2").code == 0
    quiet = run("check", path, "--frames", "-5:2", "-q")
    assert (quiet.code, quiet.out, quiet.err) == (1, "", "")


def test_jobs_give_the_same_result_in_the_same_order(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", np.linspace(OPEN, CLOSED, 9).tolist())
    one, four = (run("check", path, "-v", "--jobs", jobs).out for jobs in (1, 4))
    assert one == four and one.count("\n") == 11


def cube(
    size: float, centre: tuple[float, float, float]
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return (points - 0.5) * size + centre, np.array(quads, dtype=np.int32)


@pytest.fixture
def two_cubes(tmp_path: Path) -> Path:
    """A cube that moves by its transform through a fixed one; both have points only once."""
    from usd_io import AuthoredMesh, write_animation

    still, quads = cube(1.0, (0, 0, 0))
    moving, _ = cube(0.5, (0, 0, 0))
    matrices = np.tile(np.eye(4), (4, 1, 1))
    matrices[:, 3, 0] = (2.0, 0.51, 0.0, -2.0)  # outside, through the wall, inside, outside
    path = tmp_path / "cubes.usda"
    meshes = [
        AuthoredMesh(path="/Still/Cube", faces=quads, rest=still),
        AuthoredMesh(path="/Moving/Cube", faces=quads, rest=moving, transforms=matrices),
    ]
    write_animation(path, meshes, times=(1.0, 2.0, 3.0, 4.0))
    return path


def test_several_meshes_meet_in_world_space(two_cubes: Path) -> None:
    report = run("check", two_cubes, "--json", "-").json
    assert [frame["time"] for frame in report["frames"]] == [1, 2, 3, 4]
    pairs = [frame["before"]["pairs"] for frame in report["frames"]]
    # A cube wholly inside another intersects nothing.
    assert pairs[0] == pairs[2] == pairs[3] == 0 and pairs[1] > 0
    frame = report["frames"][1]
    assert frame["before"]["inter_pairs"] == pairs[1]
    assert {prim["path"]: prim["before"]["inter_pairs"] for prim in frame["prims"]} == {
        "/Still/Cube": pairs[1],
        "/Moving/Cube": pairs[1],
    }


def test_meshes_have_rows_with_v_and_a_table_of_what_met_what_at_the_end(two_cubes: Path) -> None:
    def lines(*options: str) -> list[list[str]]:
        return [line.split() for line in run("check", two_cubes, *options).out.splitlines()]

    header = "frame triangles pairs between meshes".split()
    head, *rows, met, columns, both, _inside, _total = lines()
    assert head == header and [row[0] for row in rows] == ["1", "2", "3", "4"]
    assert {len(row) for row in rows} == {4}
    assert met == "what met what, in all frames together:".split()
    assert columns == ["pairs", "of", "and"]
    assert both == [rows[1][2], "/Still/Cube", "/Moving/Cube"]
    head, *rows, told, _met, _columns, same, _which, _, parts, _total = lines(
        "-v", "--frames", "1:2"
    )
    assert head == [*header, "mesh"] and told[:4] == "a pair between two".split()
    of = [(row[0], row[-1]) for row in rows]
    assert of == [("1", "all"), ("2", "all"), ("2", "/Still/Cube"), ("2", "/Moving/Cube")]
    assert same == both and [parts[0], *parts[-2:]] == both
    # Frames in a row that say the same are one row.
    (_, row, total) = lines("--mode", "self")
    assert row == ["1", "to", "4,", "each", "of", "4", "0", "0", "0"]
    assert total == "no intersections in 4 frames".split()
    assert len(lines("--mode", "self", "-v")) == 6


def test_what_lies_wholly_inside_is_told(two_cubes: Path) -> None:
    told = "/Moving/Cube lies wholly inside /Still/Cube in frame 3"
    report = run("check", two_cubes, "--json", "-").json
    validate(report)
    inside = {"inner": "/Moving/Cube", "outer": "/Still/Cube", "parts": 1}
    assert [frame["enclosed"] for frame in report["frames"]] == [[], [], [inside], []]
    assert run("check", two_cubes).out.splitlines()[-2] == told
    # It intersects nothing.
    alone = run("check", two_cubes, "--frames", "3")
    assert alone.code == 0 and alone.out.splitlines()[-2] == told.removesuffix(" in frame 3")
    for left_out in (["--mode", "self"], ["--ignore", "/Still,/Moving"]):
        assert "wholly inside" not in run("check", two_cubes, *left_out).out


def write_obj(path: Path, points: NDArray[np.float64], quads: NDArray[np.int32]) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    lines += ["f " + " ".join(str(k + 1) for k in quad) for quad in quads]
    path.write_text("\n".join(lines) + "\n")


def test_parts_of_one_mesh_inside_each_other_are_told(tmp_path: Path) -> None:
    outer, quads = cube(1.0, (0, 0, 0))
    inner = [cube(0.2, (x, 0, 0))[0] for x in (-0.2, 0.2)]
    points = np.concatenate([outer, *inner])
    path = tmp_path / "eyes.obj"
    write_obj(path, points, np.concatenate([quads, quads + 8, quads + 16]))
    found = run("check", path)
    told = "2 parts of eyes.obj lie wholly inside another part of it"
    assert found.code == 0 and found.out.splitlines()[-2] == told
    write_obj(path, points, np.concatenate([quads[1:], quads + 8, quads + 16]))  # an open box
    assert "wholly inside" not in run("check", path).out


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_a_mirrored_mesh_has_its_inside_inside(two_cubes: Path, mirror: float) -> None:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(two_cubes))
    UsdGeom.Xformable(stage.GetPrimAtPath("/Still")).AddScaleOp().Set((mirror, 1, 1))
    stage.Save()
    found = run("check", two_cubes, "--frames", "3:4").out
    assert "/Moving/Cube lies wholly inside /Still/Cube in frame 3" in found


def test_mode_and_prim_choose_what_is_counted(two_cubes: Path) -> None:
    assert run("check", two_cubes, "--mode", "inter").code == 1
    assert run("check", two_cubes, "--mode", "self").code == 0
    assert run("check", two_cubes, "--prim", "/Moving//").code == 0
    assert run("check", two_cubes, "--exclude", "/Still//").code == 0


def test_blocked_samples_are_told_once_with_their_frames(tmp_path: Path) -> None:
    from pxr import Sdf

    path = tube_stage(tmp_path / "a.usda", [OPEN] * 6)
    layer = Sdf.Layer.FindOrOpen(str(path))
    for time in (2, 4, 5, 6):
        layer.SetTimeSample("/Root/Tube.points", time, Sdf.ValueBlock())
    layer.Save()
    found = run("check", path)
    told = "dtrepair: warning: /Root/Tube: the sample is blocked in frames 2, 4:6\n"
    assert found.code == 0 and found.err == told


def test_unusable_frames_end_with_4(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    path = tube_stage(tmp_path / "a.usda", (OPEN, OPEN, CLOSED))
    stage = Usd.Stage.Open(str(path))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Tube")).GetPointsAttr()
    points.Set([(float("nan"), 0, 0)] * 200, 2)
    stage.Save()
    del points, stage
    found = run("check", path)
    assert found.code == 4
    assert "1 frame could not be used" in found.out.splitlines()[-1]
    assert "frame 2" in found.err and "NaN" in found.err
    report = run("check", path, "--json", "-").json
    assert [f["status"] for f in report["frames"]] == ["clean", "failed", "unchanged"]
    assert report["frames"][1]["before"] is None


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["{obj}", "--frames", "1:10"], 2, ["--frames", "only for USD stages"]),
        (["{usd}", "--frames", "1:inf"], 2, ["1:inf"]),
        (["{usd}", "--frames", "50:60"], 2, ["50:60", "none of the frames"]),
        (["{usd}", "--prim", "/Nobody"], 2, ["/Nobody"]),
        (["{dir}/none.usd"], 3, ["none.usd", "no such file"]),
        (["{dir}/none.obj"], 3, ["none.obj", "No such file"]),
        (["{dir}/text.obj"], 3, ["text.obj", "expected a mesh with faces"]),
        (["{dir}/text.usda"], 3, ["text.usda"]),
        (["{dir}/text.doc"], 3, ["expected a mesh format", "a USD stage", "check the path"]),
        (["{dir}"], 3, ["expected a file extension", "got a folder"]),
        (["{obj}", "--json", "{dir}/none/r.json"], 5, ["none/r.json", "cannot be written"]),
        (["{obj}", "--json", "{dir}"], 5, ["is a directory"]),
        (["{obj}", "--json", "{obj}"], 2, ["is an input of this run"]),
        (["{obj}", "--device", "tpu"], 2, ["--device", "'tpu'"]),
    ],
)
def test_errors(tmp_path: Path, arguments: list[str], code: int, words: list[str]) -> None:
    names = {
        "obj": str(tube_obj(tmp_path / "a.obj")),
        "usd": str(tube_stage(tmp_path / "a.usda")),
        "dir": str(tmp_path),
    }
    for ending in ("obj", "usda", "doc"):
        (tmp_path / f"text.{ending}").write_text("hello")
    before = sorted(tmp_path.iterdir())
    assert_fails(run("check", *(text.format(**names) for text in arguments)), code, *words)
    assert sorted(tmp_path.iterdir()) == before


STATIC = ["animals", "humans", "misc", "transfer"]


@pytest.mark.parametrize("group", STATIC)
def test_static_counts_are_those_of_the_independent_checker(shared_data: Path, group: str) -> None:
    baseline = json.loads((shared_data / "baseline.json").read_text())["static"]
    entries = [entry for entry in baseline if entry["file"].startswith(group)]
    assert entries
    for entry in entries:
        found = run("check", shared_data / entry["file"], "--json", "-")
        summary = found.json["summary"]
        counts = (summary["triangles_before"], summary["pairs_before"])
        assert counts == (entry["r"]["si_tris"], entry["r"]["si_pairs"]), entry["file"]
        assert found.code == (1 if counts[1] else 0)


def test_clip_counts_are_those_of_the_independent_checker(shared_data: Path) -> None:
    for entry in json.loads((shared_data / "baseline.json").read_text())["clips"]:
        frames = run("check", shared_data / entry["file"], "--json", "-").json["frames"]
        found = [(f["time"], f["before"]["triangles"], f["before"]["pairs"]) for f in frames]
        assert found == [(r["time"], r["si_tris"], r["si_pairs"]) for r in entry["rows"]]
        if entry["prims"] > 1:
            between = [frame["before"]["inter_pairs"] for frame in frames]
            assert between == [row["inter_object_pairs"] for row in entry["rows"]]
