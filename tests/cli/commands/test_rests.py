"""`dtrepair repair --rest`: which rest a run takes, and which it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dtrepair.report.record import read_report
from tests.command_line import (
    CLOSED,
    OPEN,
    assert_fails,
    run,
    tube_obj,
    tube_polygons,
    tube_pose,
    tube_stage,
    write_obj,
)


def rest_origins(tmp_path: Path, path: Path, *options: object) -> tuple[list[str], dict[str, Any]]:
    report = tmp_path / "rest.json"
    arguments = ["-o", tmp_path / "rest.usdc", "--frames", "2", "--report", report, *options]
    assert run("repair", path, *arguments).code in (0, 1)
    return read_report(report)["settings"]["rest"], read_report(report)["prims"][0]


def test_rest_is_the_default_time_else_the_frame_with_fewest_intersections(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED, OPEN))
    assert rest_origins(tmp_path, path)[0] == ["default time"]
    bare = tube_stage(tmp_path / "b.usda", (CLOSED, CLOSED, OPEN), rest=None)
    assert rest_origins(tmp_path, bare, "--frames", "1:2")[0] == ["frame 3"]
    origins, _ = rest_origins(tmp_path, bare, "--frames", "1:3")
    assert origins == ["frame 3"]


def test_rest_by_option(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, CLOSED, OPEN))
    origins, prim = rest_origins(tmp_path, path, "--rest", "3")
    assert origins == ["frame 3"] and prim["rest_intersections"] == 0
    origins, prim = rest_origins(tmp_path, path, "--rest", "1")
    assert origins == ["frame 1"] and prim["rest_intersections"] > 0
    quads = tube_obj(tmp_path / "rest.obj", OPEN)
    origins, prim = rest_origins(tmp_path, path, "--rest", quads)
    assert origins == [str(quads)] and prim["rest_intersections"] == 0
    outside = run("repair", path, "-o", tmp_path / "x.usdc", "--rest", "99")
    assert_fails(outside, 2, "--rest 99", "samples from 1 to 3")
    other = tube_stage(tmp_path / "other.usda", (CLOSED,), rest=2.0)
    assert rest_origins(tmp_path, path, "--rest", other)[0] == [str(other)]


def test_bad_rests_are_refused(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED, OPEN))
    out = ["-o", tmp_path / "b.usdc"]
    wrong = write_obj(tmp_path / "w.obj", np.eye(3), np.array([[0, 1, 2]]))
    assert_fails(run("repair", path, *out, "--rest", wrong), 3, "w.obj", "expected the topology")
    assert_fails(run("repair", path, *out, "--rest", tmp_path / "no.obj"), 3, "no.obj")
    assert_fails(run("repair", path, *out, "--rest", "inf"), 2, "--rest inf")
    still = tube_stage(tmp_path / "still.usda", ())
    assert_fails(run("repair", still, *out, "--rest", "2"), 2, "--rest 2", "changes over time")
    mesh, moved = tube_obj(tmp_path / "m.obj"), ["-o", tmp_path / "b.obj"]
    assert_fails(run("repair", mesh, *moved, "--rest", "2"), 2, "--rest 2", "no file has that")
    shuffled = write_obj(tmp_path / "s.obj", tube_pose(OPEN), tube_polygons()[::-1])
    assert_fails(run("repair", path, *out, "--rest", shuffled), 3, "expected the topology")
    assert not (tmp_path / "b.usdc").exists()


def test_intersecting_rest_is_a_warning(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED), rest=CLOSED)
    done = run("repair", path, "-o", tmp_path / "b.usdc", "-q", "--report", tmp_path / "r.json")
    assert done.err == "" and done.out == ""
    told = run("repair", path, "-o", tmp_path / "b.usdc").err
    assert "rest poses that intersect themselves: /Root/Tube (" in told
    assert " triangles, default time); " in told and "--rest" in told


def test_an_intersecting_rest_is_told_of_a_single_frame_as_well(tmp_path: Path) -> None:
    words = "rest poses that intersect themselves: "
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    one = ("repair", path, "-o", tmp_path / "b.usdc", "--frames", "3")
    assert f"{words}/Root/Tube (" in run(*one, "--rest", "2").err
    assert words not in run(*one).err
    bound = tube_stage(tmp_path / "c.usda", (OPEN, OPEN), rest=CLOSED)
    assert words in run("repair", bound, "-o", tmp_path / "d.usdc", "--frames", "1").err
    # A mesh file is what is repaired, another one that is named is not.
    mesh, out = tube_obj(tmp_path / "m.obj", OPEN), ("-o", tmp_path / "n.obj")
    assert words in run("repair", mesh, *out, "--rest", tube_obj(tmp_path / "r.obj", CLOSED)).err
    assert words not in run("repair", tmp_path / "r.obj", *out).err


def test_one_line_tells_of_all_rests_that_are_at_fault(tmp_path: Path) -> None:
    """Five meshes that intersect themselves are one warning; a collider among them another."""
    from usd_io import AuthoredMesh, write_animation

    meshes = [
        AuthoredMesh(
            path=f"/Root/Tube{number}",
            faces=tube_polygons(),
            points=[tube_pose(OPEN), tube_pose(OPEN)],
            rest=tube_pose(CLOSED),
        )
        for number in range(5)
    ]
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=[1.0, 2.0])
    out = ["repair", path, "-o", tmp_path / "b.usda", "--ignore", "/Root,/Root"]
    lines = run(*out, "--collider", "/Root/Tube4").err.splitlines()
    (rests,) = (line for line in lines if "rest poses" in line)
    assert "/Root/Tube0 (" in rests and "/Root/Tube2 (" in rests and "and 1 more; " in rests
    (still,) = (line for line in lines if "colliders that intersect" in line)
    assert "/Root/Tube4; as a collider never moves" in still and "/Root/Tube3" not in still
