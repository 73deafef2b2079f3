"""`dtrepair transfer` of stages: layers, axes, repair, pins, checks and errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair.report.record import read_report
from tests.command_line import (
    CLOSED,
    assert_fails,
    read_samples,
    run,
    tube_obj,
    tube_polygons,
    tube_pose,
    tube_stage,
    write_obj,
)
from tests.usd_stages import authored_properties
from usd_io import AuthoredMesh, write_animation

TURN_X = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # Y up to Z up, column vectors
TIMES = (1.5, 2.25, 7.0)


@pytest.fixture
def stages(tmp_path: Path) -> tuple[Path, Path, Path]:
    """An animated tube and another tube, thicker, of the same topology."""
    source = tube_stage(tmp_path / "a.usda", (1.0, 2.0, CLOSED), rest=0.0, times=TIMES)
    thick = tube_pose(0.0) * (1.3, 1.3, 1.0)
    mesh = AuthoredMesh(path="/Hero/Tube", faces=tube_polygons(), rest=thick)
    write_animation(tmp_path / "b.usda", mesh)
    return source, tmp_path / "b.usda", tmp_path / "c.usdc"


def test_a_stage_as_target_gives_a_layer_over_it(stages: tuple[Path, Path, Path]) -> None:
    from pxr import Sdf, Usd

    source, target, output = stages
    before = target.read_bytes()
    assert run("transfer", source, target, "-o", output).code == 1
    assert tuple(read_samples(output, "/Hero/Tube")) == TIMES
    assert authored_properties(output) == {"/Hero/Tube.points", "/Hero/Tube.extent"}
    layer = Sdf.Layer.FindOrOpen(str(output))
    assert list(layer.subLayerPaths) == ["./b.usda"]
    stage = Usd.Stage.Open(str(output))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.5, 7.0)
    assert target.read_bytes() == before
    assert layer.customLayerData["dtrepair"]["transfer"]["correspondence"] == "topology"


def test_the_source_onto_itself_comes_back(stages: tuple[Path, Path, Path], tmp_path: Path) -> None:
    source, _, output = stages
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    assert run("transfer", source, rest, "-o", output).code == 1
    found, expected = read_samples(output, "/rest/Mesh"), read_samples(source)
    for time in TIMES:
        # float32 in, float32 out.
        assert np.abs(found[time] - expected[time]).max() < 1e-5


def test_repair_ends_at_zero_intersections(stages: tuple[Path, Path, Path]) -> None:
    source, target, output = stages
    report = output.with_suffix(".json")
    done = run("transfer", source, target, "-o", output, "--repair", "--report", report)
    assert done.code == 0, done
    assert run("check", output).code == 0
    frames = read_report(report)["frames"]
    assert frames[2]["before"]["triangles"] > 0 and frames[2]["after"]["triangles"] == 0
    assert frames[2]["displacement_max"] > 0.0
    assert "3 of 3 frames clean" in done.out and "repaired" in done.out


def test_frames_may_be_repaired_alone(stages: tuple[Path, Path, Path]) -> None:
    source, target, output = stages
    report = output.with_suffix(".json")
    arguments = ("transfer", source, target, "-o", output, "--repair", "--report", report)
    assert run(*arguments, "--alone", "--clearance", 1e-4).code == 0
    frames = read_report(report)["frames"]
    assert frames[0]["displacement_max"] == 0.0 < frames[2]["displacement_max"]
    assert run(*arguments, "--clearance", 1e-4).code == 0
    assert_fails(run(*arguments[:5], "--alone"), 2, "--alone", "--repair")


def test_without_repair_intersections_are_told(stages: tuple[Path, Path, Path]) -> None:
    source, target, output = stages
    done = run("transfer", source, target, "-o", output)
    assert done.code == 1 and "--repair removes them" in done.out
    assert run("check", output, "--frames", "7").code == 1


def test_rates_and_ranges_follow_the_source(
    stages: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    from pxr import Usd

    source, target, output = stages
    stage = Usd.Stage.Open(str(source))
    stage.SetTimeCodesPerSecond(48.0)
    stage.GetRootLayer().Save()
    run("transfer", source, target, "-o", output)
    assert Usd.Stage.Open(str(output)).GetTimeCodesPerSecond() == 48.0
    assert tuple(read_samples(output, "/Hero/Tube")) == TIMES
    stage = Usd.Stage.Open(str(target))
    stage.SetStartTimeCode(1.0)
    stage.SetEndTimeCode(9.0)
    stage.GetRootLayer().Save()
    done = run("transfer", source, target, "-o", output)
    assert "changes its speed" in done.err
    assert Usd.Stage.Open(str(output)).GetTimeCodesPerSecond() == 24.0
    assert tuple(read_samples(output, "/Hero/Tube")) == TIMES


def test_an_animation_of_the_target_is_replaced(
    stages: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    source = stages[0]
    target = tube_stage(tmp_path / "t.usda", (0.5, 0.6, 0.7), rest=0.0)
    done = run("transfer", source, target, "-o", stages[2])
    assert "the animation of /Root/Tube is replaced" in done.err
    assert tuple(read_samples(stages[2])) == TIMES


def turned_target(path: Path, *, up: str = "Z", scale: float = 1.0, units: float = 1.0) -> Path:
    """The straight tube with its local axes turned from Y up to Z up."""
    mesh = AuthoredMesh(
        path="/Hero/Tube", faces=tube_polygons(), rest=scale * tube_pose(0.0) @ TURN_X.T
    )
    write_animation(path, mesh, up=up, meters_per_unit=units)
    return path


def test_up_axes_are_turned_into_each_other(
    stages: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    source, _, output = stages
    target = turned_target(tmp_path / "z.usda", scale=3.0)
    done = run("transfer", source, target, "-o", output)
    assert done.err == ""
    found, expected = read_samples(output, "/Hero/Tube"), read_samples(source)
    # Root and height follow too: both rests lie around the origin.
    for time in TIMES:
        shift = (found[time] - 3.0 * expected[time] @ TURN_X.T).mean(axis=0)
        assert np.abs(found[time] - shift - 3.0 * expected[time] @ TURN_X.T).max() < 1e-4


def test_rests_that_face_other_ways_are_told_and_aligned(
    stages: tuple[Path, Path, Path], tmp_path: Path
) -> None:
    source, _, output = stages
    target = turned_target(tmp_path / "z.usda", up="Y")
    done = run("transfer", source, target, "-o", output)
    assert "90 degrees apart" in done.err and "--align rests" in done.err
    aligned = run("transfer", source, target, "-o", output, "--align", "rests")
    assert "degrees apart" not in aligned.err
    expected, found = read_samples(source)[2.25], read_samples(output, "/Hero/Tube")[2.25]
    edges = tube_polygons()[:, :2]
    first, second = ((p[edges[:, 1]] - p[edges[:, 0]]) for p in (expected @ TURN_X.T, found))
    assert np.abs(first - second).max() < 1e-4
    told = run("transfer", source, target, "-o", output, "--target-up", "z")
    assert "degrees apart" not in told.err


def test_pins_hold_vertices(stages: tuple[Path, Path, Path], tmp_path: Path) -> None:
    source, target, output = stages
    vertices = np.arange(8)
    places = tube_pose(0.0)[vertices] * (1.3, 1.3, 1.0)
    np.savez(tmp_path / "pin.npz", vertices=vertices)
    run("transfer", source, target, "-o", output, "--pin", tmp_path / "pin.npz")
    found = read_samples(output, "/Hero/Tube")
    assert all((found[time][vertices] == places.astype(np.float32)).all() for time in TIMES)
    moving = np.tile(places, (3, 1, 1))
    moving[1, :, 1] += 0.5
    moving[2] = np.nan
    np.savez(tmp_path / "pin.npz", vertices=vertices, positions=moving)
    run("transfer", source, target, "-o", output, "--pin", tmp_path / "pin.npz")
    found = read_samples(output, "/Hero/Tube")
    assert (found[2.25][vertices] == moving[1].astype(np.float32)).all()
    assert np.abs(found[7.0][vertices] - places).max() > 0.1


def test_pins_named_on_the_target(stages: tuple[Path, Path, Path]) -> None:
    from pxr import Usd, UsdGeom

    source, target, output = stages
    stage = Usd.Stage.Open(str(target))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Hero/Tube"))
    UsdGeom.Subset.CreateGeomSubset(mesh, "seat", UsdGeom.Tokens.point, [3, 4, 5])
    stage.GetRootLayer().Save()
    done = run("transfer", source, target, "-o", output, "--pin", "seat", "--repair")
    assert done.code in (0, 1)
    rest = np.asarray(mesh.GetPointsAttr().Get())
    found = read_samples(output, "/Hero/Tube")
    assert all((found[time][3:6] == rest[3:6]).all() for time in TIMES)
    assert_fails(run("transfer", source, target, "-o", output, "--pin", "no"), 2, "--pin no")


def test_bad_pins_are_refused(stages: tuple[Path, Path, Path], tmp_path: Path) -> None:
    source, target, output = stages
    arguments = ("transfer", source, target, "-o", output, "--pin", tmp_path / "p.npz")
    np.savez(tmp_path / "p.npz", vertices=[0, 9999])
    assert_fails(run(*arguments), 3, "up to 9999")
    np.savez(tmp_path / "p.npz", vertices=[0, 0])
    assert_fails(run(*arguments), 3, "--pin", "one twice")
    np.savez(tmp_path / "p.npz", vertices=[0, 1], positions=np.zeros((5, 2, 3)))
    assert_fails(run(*arguments), 3, "(3, 2, 3)", "(5, 2, 3)")
    mesh = tube_obj(tmp_path / "b.obj", 0.0)
    assert_fails(run("transfer", source, mesh, "-o", output, "--pin", "seat"), 3, "npz")
    assert_fails(run(*arguments, "--ground"), 2, "--ground")


def test_rests_an_artist_should_look_at(stages: tuple[Path, Path, Path], tmp_path: Path) -> None:
    source, _, output = stages
    quads = tube_polygons()
    doubled = np.concatenate([quads, quads[:1]])
    write_obj(tmp_path / "a.obj", tube_pose(0.0), doubled)
    pose = write_obj(tmp_path / "p.obj", tube_pose(1.0), doubled)
    done = run("transfer", tmp_path / "a.obj", tmp_path / "a.obj", "--poses", pose, "-o", output)
    assert "non-manifold edges" in done.err
    inward = write_obj(tmp_path / "b.obj", tube_pose(0.0), quads[:, ::-1])
    other = write_obj(tmp_path / "c.obj", tube_pose(0.0), quads[:, ::-1])
    for target, lines in ((inward, 1), (other, 2)):
        shown = run("transfer", inward, target, "--poses", inward, "-o", output, "--dry-run")
        assert shown.err.count("wound inside out") == lines
    tiny = turned_target(tmp_path / "z.usda", units=0.001)
    shown = run("transfer", source, tiny, "-o", output, "--dry-run")
    assert "metersPerUnit" in shown.err
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mesh = AuthoredMesh("/A/Tube", tube_polygons(), rest=tube_pose(0.0), transforms=mirror)
    write_animation(tmp_path / "mirrored.usda", mesh)
    shown = run("transfer", source, tmp_path / "mirrored.usda", "-o", output, "--dry-run")
    assert "mirrors it" in shown.err


def test_dry_run_and_skip_existing_write_nothing(stages: tuple[Path, Path, Path]) -> None:
    source, target, output = stages
    shown = run("transfer", source, target, "-o", output, "--dry-run")
    assert shown.code == 0 and "3 frames (1.5 to 7) would be written" in shown.out
    assert not output.exists() and sorted(p.name for p in output.parent.iterdir()) == [
        "a.usda",
        "b.usda",
    ]
    mine = tube_stage(output).read_bytes()
    skipped = run("transfer", source, target, "-o", output, "--skip-existing")
    assert skipped.code == 0 and "skipped" in skipped.out and output.read_bytes() == mine


def test_usage_errors(stages: tuple[Path, Path, Path], tmp_path: Path) -> None:
    source, target, output = stages
    mesh = tube_obj(tmp_path / "m.obj", 0.0)
    assert_fails(run("transfer", mesh, target, "-o", output), 2, "--poses")
    assert_fails(run("transfer", source, target, "-o", "out.obj"), 2, "animation", ".usd")
    assert_fails(run("transfer", source, mesh, "-o", tmp_path / "o.usdz"), 2, "usdz")
    assert_fails(run("transfer", source, target, "-o", source), 2, "is an input")
    assert_fails(run("transfer", source, target, "-o", tmp_path / "no" / "o.usd"), 5, "directory")
    assert_fails(run("transfer", source, mesh, "-o", tmp_path / "no" / "o.usd"), 5, "directory")
    assert_fails(run("transfer", source, target, "-o", output, "--tighten", 2), 2, "--repair")
    two = ("transfer", source, mesh, "-o", output, "--poses", source, source)
    assert_fails(run(*two), 2, "one stage")
    wrong = ("transfer", source, mesh, "-o", output, "--target-prim", "/X")
    assert_fails(run(*wrong), 2, "only for USD stages")
    report = ("--report", output)
    assert_fails(run("transfer", source, target, "-o", output, *report), 2, "another output")


def test_one_of_several_meshes_is_chosen(stages: tuple[Path, Path, Path], tmp_path: Path) -> None:
    source, _, output = stages
    meshes = [
        AuthoredMesh(path=f"/Hero/{name}", faces=tube_polygons(), rest=tube_pose(0.0))
        for name in ("Body", "Coat")
    ]
    write_animation(tmp_path / "two.usda", meshes)
    arguments = ("transfer", source, tmp_path / "two.usda", "-o", output)
    # Both have the topology of the source.
    done = run(*arguments)
    assert done.code == 1 and "0 of 768 target triangles unmatched" in done.out
    assert len(authored_properties(output)) == 4
    assert_fails(run(*arguments, "--match", "/Root/Tube"), 2, "expected a prim of SOURCE")
    assert_fails(run(*arguments, "--match", "/Root/Tube,/Hero"), 2, "/Hero is 2 meshes")
    run(*arguments, "--target-prim", "/Hero/Coat")
    assert authored_properties(output) == {"/Hero/Coat.points", "/Hero/Coat.extent"}
