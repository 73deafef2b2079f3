"""`dtrepair transfer`: inputs, outputs, axes, repair, checks and errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import (
    CLOSED,
    OPEN,
    assert_fails,
    read_samples,
    run,
    tube_obj,
    tube_polygons,
    tube_pose,
    tube_stage,
    write_obj,
)
from meshes import split_quads
from quadruped import Quadruped, markers
from usd_stages import authored_properties

import usd_io
from dtrepair.geometry import diagonal
from dtrepair.record import read_report, validate
from dtrepair.transfer import Transfer, match_triangles, register
from usd_io import AuthoredMesh, write_animation

SOURCE = Quadruped(cells=8.0)
TARGET = Quadruped(cells=9.0, body=0.85, width=0.38, leg=1.1, thickness=0.12, neck=0.8)
TURN_X = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # Y up to Z up, column vectors


@pytest.fixture(scope="module")
def animals(tmp_path_factory):
    """Source and target rests with markers as files, and three poses of the source."""
    folder = tmp_path_factory.mktemp("animals")
    source, target = SOURCE.mesh(), TARGET.mesh()
    write_obj(folder / "source.obj", *source)
    write_obj(folder / "target.obj", *target)
    rows = markers(SOURCE, source[0], TARGET, target[0])
    (folder / "m.cons").write_text(f"{len(rows)}\n" + "".join(f"{a}, {b}\n" for a, b in rows))
    for number, pose in enumerate(SOURCE.walk(source[0], 3), start=1):
        write_obj(folder / f"pose{number}.obj", pose, source[1])
    return folder, source, target, rows


def poses(folder: Path) -> list[Path]:
    return sorted(folder.glob("pose?.obj"))


@pytest.fixture(scope="module")
def transferred(animals):
    """One run with everything that is written beside the animation."""
    folder = animals[0]
    done = run(
        *("transfer", folder / "source.obj", folder / "target.obj", "--poses", *poses(folder)),
        *("--markers", folder / "m.cons", "-o", folder / "out.usdc"),
        *("--report", folder / "r.json", "--save-correspondence", folder / "c.npz"),
        *("--picture", folder / "p.png"),
    )
    return folder, done


def test_mesh_files_give_a_new_stage(animals, transferred):
    _, source, target, rows = animals
    folder, done = transferred
    assert done.code in (0, 1) and done.err == ""
    samples = read_samples(folder / "out.usdc", "/target/Mesh")
    assert list(samples) == [1.0, 2.0, 3.0]
    pairs = match_triangles(register(*source, *target, rows), source[1], *target)
    expected = Transfer(*source, *target, pairs)(SOURCE.walk(source[0], 3))
    found = np.stack(list(samples.values()))
    # The same call on the same numbers, rounded once.
    assert np.abs(found - expected).max() < 1e-6 * diagonal(target[0])
    assert np.abs(found[0] - found[1]).max() > 0.1


def test_the_report_tells_coverage_residual_and_markers(transferred):
    folder, done = transferred
    report = read_report(folder / "r.json")
    section = report["transfer"]
    assert section["correspondence"] == "markers" and section["target"] == "target.obj"
    assert section["unmatched"] < 0.005 * report["prims"][0]["triangles"]
    assert 0 < section["residual_median"] < section["residual_p95"] < 0.6
    assert section["markers"]["suspects"] == [] and section["markers"]["count"] > 20
    assert section["unit_ratio"] == pytest.approx(1.0, abs=0.05)
    assert f"{section['pairs']} pairs of triangles (markers)" in done.out
    assert f"residual: median {section['residual_median']:.3f}" in done.out
    assert "written: " in done.out
    section["residual_median"] = -1.0
    with pytest.raises(ValueError, match=r"transfer\.residual_median"):
        validate(report)


def test_the_picture_shows_three_views(transferred):
    from PIL import Image

    with Image.open(transferred[0] / "p.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert pixels.shape[1] == 3 * 640
    red = (pixels[..., 0] > 120) & (pixels[..., 1] < 60)
    assert red[:, 1280:].sum() > 1000 and red[:, :640].sum() == 0


def test_a_saved_correspondence_gives_the_same_animation(animals, transferred, tmp_path):
    folder = transferred[0]
    arguments = ("transfer", folder / "source.obj", folder / "target.obj")
    again = tmp_path / "again.usdc"
    chosen = ("--correspondence", folder / "c.npz", "--frames", "2:3", "-o", again)
    assert run(*arguments, "--poses", *poses(folder), *chosen).code in (0, 1)
    before, after = (read_samples(p, "/target/Mesh") for p in (folder / "out.usdc", again))
    assert list(after) == [2.0, 3.0]
    assert all((before[time] == after[time]).all() for time in after)
    swapped = ("transfer", folder / "target.obj", folder / "source.obj")
    done = run(*swapped, "--poses", folder / "target.obj", *chosen[:2], "-o", again)
    assert_fails(done, 3, "c.npz", "match the meshes again")


def test_markers_as_npz(animals, tmp_path):
    folder, _, _, rows = animals
    np.savez(tmp_path / "m.npz", markers=rows)
    arguments = ("transfer", folder / "source.obj", folder / "target.obj", "--dry-run")
    output = ("--poses", folder / "pose1.obj", "-o", tmp_path / "o.usdc", "--markers")
    assert run(*arguments, *output, tmp_path / "m.npz").code == 0
    np.savez(tmp_path / "n.npz", pairs=rows)
    arguments = arguments[:3]
    assert_fails(run(*arguments, *output, tmp_path / "n.npz"), 3, "'markers'", "got pairs")
    assert_fails(run(*arguments, *output, tmp_path / "no.npz"), 3, "no such file")
    (tmp_path / "bad.npz").write_text("nothing")
    assert_fails(run(*arguments, *output, tmp_path / "bad.npz"), 3, "is not an npz")


def test_swapped_markers_are_named(animals, tmp_path):
    folder, _, _, rows = animals
    rows = rows.copy()
    rows[[3, 40], 1] = rows[[40, 3], 1]
    np.savez(tmp_path / "m.npz", markers=rows)
    done = run(
        *("transfer", folder / "source.obj", folder / "target.obj", "--poses", poses(folder)[0]),
        *("--markers", tmp_path / "m.npz", "-o", tmp_path / "o.usdc"),
        *("--report", tmp_path / "r.json"),
    )
    assert done.code in (0, 1)
    assert "swapped with marker 40?" in done.err and "swapped with marker 3?" in done.err
    report = read_report(tmp_path / "r.json")
    assert report["transfer"]["markers"]["swapped"] == [[3, 40]]
    assert any("swapped with marker 40?" in text for text in report["warnings"])


def test_bad_markers_are_refused(animals, tmp_path):
    folder = animals[0]
    arguments = ("transfer", folder / "source.obj", folder / "target.obj")
    arguments += ("--poses", poses(folder)[0], "-o", tmp_path / "o.usdc")
    bad = tmp_path / "m.cons"
    bad.write_text("3\n0, 1\n2, 3\n0, 5\n")
    assert_fails(run(*arguments, "--markers", bad), 3, "m.cons", "one marker", "vertex 0")
    bad.write_text("0 1\n2 99999\n4 5")
    assert_fails(run(*arguments, "--markers", bad), 3, "index 99999 in marker 1")
    bad.write_text("0 1\n2 3")
    assert_fails(run(*arguments, "--markers", bad), 3, "at least 3 markers")
    assert_fails(run(*arguments, "--markers", tmp_path / "no"), 3, "cannot be read")
    assert_fails(run(*arguments), 2, "--markers", "same triangles")
    both = ("--markers", bad, "--correspondence", bad)
    assert_fails(run(*arguments, *both), 2, "give one of them")
    assert not (tmp_path / "o.usdc").exists()


TIMES = (1.5, 2.25, 7.0)


@pytest.fixture
def stages(tmp_path):
    """An animated tube and another tube, thicker, of the same topology."""
    source = tube_stage(tmp_path / "a.usda", (1.0, 2.0, CLOSED), rest=0.0, times=TIMES)
    thick = tube_pose(0.0) * (1.3, 1.3, 1.0)
    mesh = AuthoredMesh(path="/Hero/Tube", faces=tube_polygons(), rest=thick)
    write_animation(tmp_path / "b.usda", mesh)
    return source, tmp_path / "b.usda", tmp_path / "c.usdc"


def test_a_stage_as_target_gives_a_layer_over_it(stages):
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


def test_the_source_onto_itself_comes_back(stages, tmp_path):
    source, _, output = stages
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    assert run("transfer", source, rest, "-o", output).code == 1
    found, expected = read_samples(output, "/rest/Mesh"), read_samples(source)
    for time in TIMES:
        # float32 in, float32 out.
        assert np.abs(found[time] - expected[time]).max() < 1e-5


def test_repair_ends_at_zero_intersections(stages):
    source, target, output = stages
    report = output.with_suffix(".json")
    done = run("transfer", source, target, "-o", output, "--repair", "--report", report)
    assert done.code == 0, done
    assert run("check", output).code == 0
    frames = read_report(report)["frames"]
    assert frames[2]["before"]["triangles"] > 0 and frames[2]["after"]["triangles"] == 0
    assert frames[2]["displacement_max"] > 0.0
    assert "3 of 3 frames clean" in done.out and "repaired" in done.out


def test_frames_may_be_repaired_alone(stages):
    source, target, output = stages
    report = output.with_suffix(".json")
    arguments = ("transfer", source, target, "-o", output, "--repair", "--report", report)
    assert run(*arguments, "--alone", "--clearance", 1e-4).code == 0
    frames = read_report(report)["frames"]
    assert frames[0]["displacement_max"] == 0.0 < frames[2]["displacement_max"]
    assert_fails(run(*arguments, "--clearance", 1e-4), 2, "--clearance", "--alone")
    assert_fails(run(*arguments[:5], "--alone"), 2, "--alone", "--repair")


def test_without_repair_intersections_are_told(stages):
    source, target, output = stages
    done = run("transfer", source, target, "-o", output)
    assert done.code == 1 and "--repair removes them" in done.out
    assert run("check", output, "--frames", "7").code == 1


def test_rates_and_ranges_follow_the_source(stages, tmp_path):
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


def test_an_animation_of_the_target_is_replaced(stages, tmp_path):
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


def test_up_axes_are_turned_into_each_other(stages, tmp_path):
    source, _, output = stages
    target = turned_target(tmp_path / "z.usda", scale=3.0)
    done = run("transfer", source, target, "-o", output)
    assert done.err == ""
    found, expected = read_samples(output, "/Hero/Tube"), read_samples(source)
    # Root and height follow too: both rests lie around the origin.
    for time in TIMES:
        shift = (found[time] - 3.0 * expected[time] @ TURN_X.T).mean(axis=0)
        assert np.abs(found[time] - shift - 3.0 * expected[time] @ TURN_X.T).max() < 1e-4


def test_rests_that_face_other_ways_are_told_and_aligned(stages, tmp_path):
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


def test_motion_of_the_sources_transform_is_taken_along(tmp_path):
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, 3, 0] = (5.0, 6.0, 8.0)
    poses_of = [tube_pose(0.5)] * 3
    mesh = AuthoredMesh(
        "/A/Tube", tube_polygons(), poses_of, rest=tube_pose(0.0), transforms=matrices
    )
    write_animation(tmp_path / "a.usda", mesh, times=(1, 2, 3))
    target = tube_obj(tmp_path / "b.obj", 0.0)
    run("transfer", tmp_path / "a.usda", target, "-o", tmp_path / "c.usda", "--root-scale", 1)
    found = np.stack(list(read_samples(tmp_path / "c.usda", "/b/Mesh").values()))
    travel = (found - found[0]).mean(axis=1)
    assert np.abs(travel - np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0]])).max() < 1e-4


def test_ground_keeps_the_feet_down(animals, transferred, tmp_path):
    folder, _, target, _ = animals
    arguments = ("transfer", folder / "source.obj", folder / "target.obj", "--poses")
    more = ("--correspondence", folder / "c.npz", "-o", tmp_path / "o.usdc", "--ground")
    assert run(*arguments, *poses(folder), *more).code in (0, 1)
    lowest = [p[:, 1].min() for p in read_samples(tmp_path / "o.usdc", "/target/Mesh").values()]
    # The walk keeps the source's lowest vertex where it is at rest.
    assert np.abs(np.array(lowest) - target[0][:, 1].min()).max() < 1e-5 * diagonal(target[0])


def test_pins_hold_vertices(stages, tmp_path):
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


def test_pins_named_on_the_target(stages):
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


def test_bad_pins_are_refused(stages, tmp_path):
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


def test_a_bad_pose_fails_alone(animals, tmp_path):
    folder, source, _, _ = animals
    bad = tmp_path / "bad.obj"
    write_obj(bad, source[0][:-1], np.clip(source[1], 0, len(source[0]) - 2))
    other = write_obj(tmp_path / "other.obj", source[0], source[1][::-1])
    files = (poses(folder)[0], bad, other, poses(folder)[1])
    arguments = ("transfer", folder / "source.obj", folder / "source.obj", "--poses", *files)
    done = run(*arguments, "-o", tmp_path / "o.usda")
    assert done.code == 4
    assert "frame 2: failed" in done.err and "bad.obj: expected" in done.err
    assert "frame 3: failed" in done.err and "the faces are not those" in done.err
    assert list(read_samples(tmp_path / "o.usda", "/source/Mesh")) == [1.0, 4.0]
    none = run(*arguments[:4], bad, "-o", tmp_path / "none.usda")
    assert none.code == 3 and "no frame could be used" in none.err
    assert not (tmp_path / "none.usda").exists()
    missing = run(*arguments, tmp_path / "missing.obj", "-o", tmp_path / "none.usda")
    assert_fails(missing, 3, "missing.obj", "--poses")


def test_a_rest_file_with_an_animated_stage(stages, tmp_path):
    source = tube_stage(tmp_path / "anim.usda", (1.0, 2.0), rest=None)
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    done = run("transfer", rest, rest, "--poses", source, "-o", stages[2])
    assert done.code == 0 and done.err == ""
    found, expected = read_samples(stages[2], "/rest/Mesh"), read_samples(source)
    assert np.abs(found[2.0] - expected[2.0]).max() < 1e-5
    guessed = run("transfer", source, rest, "-o", stages[2])
    assert "its rest pose is taken from frame 1" in guessed.err


def test_rests_an_artist_should_look_at(stages, tmp_path):
    source, _, output = stages
    quads = tube_polygons()
    doubled = np.concatenate([quads, quads[:1]])
    write_obj(tmp_path / "a.obj", tube_pose(0.0), doubled)
    pose = write_obj(tmp_path / "p.obj", tube_pose(1.0), doubled)
    done = run("transfer", tmp_path / "a.obj", tmp_path / "a.obj", "--poses", pose, "-o", output)
    assert "non-manifold edges" in done.err
    inward = write_obj(tmp_path / "b.obj", tube_pose(0.0), quads[:, ::-1])
    shown = run("transfer", inward, inward, "--poses", inward, "-o", output, "--dry-run")
    assert shown.err.count("wound inside out") == 2
    tiny = turned_target(tmp_path / "z.usda", units=0.001)
    shown = run("transfer", source, tiny, "-o", output, "--dry-run")
    assert "metersPerUnit" in shown.err
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    mesh = AuthoredMesh("/A/Tube", tube_polygons(), rest=tube_pose(0.0), transforms=mirror)
    write_animation(tmp_path / "mirrored.usda", mesh)
    shown = run("transfer", source, tmp_path / "mirrored.usda", "-o", output, "--dry-run")
    assert "mirrors it" in shown.err


def test_poses_in_other_units_are_told(tmp_path):
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    large = write_obj(tmp_path / "large.obj", 100 * tube_pose(1.0), tube_polygons())
    done = run("transfer", rest, rest, "--poses", large, "-o", tmp_path / "o.usda")
    assert "in other units" in done.err


def test_dry_run_and_skip_existing_write_nothing(stages):
    source, target, output = stages
    shown = run("transfer", source, target, "-o", output, "--dry-run")
    assert shown.code == 0 and "3 frames (1.5 to 7) would be written" in shown.out
    assert not output.exists() and sorted(p.name for p in output.parent.iterdir()) == [
        "a.usda",
        "b.usda",
    ]
    output.write_text("mine")
    skipped = run("transfer", source, target, "-o", output, "--skip-existing")
    assert skipped.code == 0 and "skipped" in skipped.out and output.read_text() == "mine"


def test_usage_errors(stages, tmp_path):
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
    assert_fails(run("transfer", source, target, "-o", output, *report), 2, "is an input")


def test_one_of_several_meshes_is_chosen(stages, tmp_path):
    source, _, output = stages
    meshes = [
        AuthoredMesh(path=f"/Hero/{name}", faces=tube_polygons(), rest=tube_pose(0.0))
        for name in ("Body", "Coat")
    ]
    write_animation(tmp_path / "two.usda", meshes)
    arguments = ("transfer", source, tmp_path / "two.usda", "-o", output)
    assert_fails(run(*arguments), 2, "/Hero/Body, /Hero/Coat", "--target-prim")
    run(*arguments, "--target-prim", "/Hero/Coat")
    assert authored_properties(output) == {"/Hero/Coat.points", "/Hero/Coat.extent"}


def test_polygons_and_texture_reach_the_new_stage(stages, tmp_path):
    from pxr import Usd, UsdGeom

    quads = tube_polygons()
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in tube_pose(0.0).tolist()]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1"]
    lines += ["f " + " ".join(f"{v + 1}/{k % 3 + 1}" for k, v in enumerate(q)) for q in quads]
    (tmp_path / "9 lives.obj").write_text("\n".join(lines))
    assert run("transfer", stages[0], tmp_path / "9 lives.obj", "-o", stages[2]).code == 1
    stage = Usd.Stage.Open(str(stages[2]))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/_9_lives/Mesh"))
    assert set(mesh.GetFaceVertexCountsAttr().Get()) == {4}
    corners = np.asarray(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 4)
    assert (corners == quads).all() and len(split_quads(corners)) == 384
    assert len(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st").Get()) == 3


def test_the_horse_moves_the_camel(shared_data, tmp_path):
    folder = shared_data / "transfer"
    done = run(
        *("transfer", folder / "horse/horse_ref.obj", folder / "camel/camel_ref.obj"),
        *("--poses", folder / "horse/horse-03.obj", folder / "horse/horse-07.obj", "--repair"),
        *("--markers", folder / "horse_camel.cons", "-o", tmp_path / "o.usdc", "-q"),
    )
    assert (done.code, done.out, done.err) == (0, "", "")
    assert run("check", tmp_path / "o.usdc", "-q").code == 0


def test_closed_and_open_tubes_are_what_the_tests_need():
    assert OPEN < 2 * np.pi < CLOSED


@pytest.fixture
def shape_files(tmp_path):
    """A straight tube, a thicker one, and two shapes of the first."""
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    write_obj(tmp_path / "thick.obj", tube_pose(0.0) * (1.3, 1.3, 1.0), tube_polygons())
    return (
        rest,
        tmp_path / "thick.obj",
        [
            tube_obj(tmp_path / "bent a.obj", 0.6),
            tube_obj(tmp_path / "9.obj", 1.2),
        ],
    )


def test_shapes_become_blend_shapes(shape_files, tmp_path):
    rest, thick, shapes = shape_files
    output, clip = tmp_path / "o.usda", tmp_path / "clip.usda"
    arguments = ("transfer", rest, thick, "--poses", *shapes, "-o")
    assert run(*arguments, output, "--shapes", "--report", tmp_path / "r.json").code == 0
    assert run(*arguments, clip).code == 0
    text = output.read_text()
    assert '"bent_a", "_9"' in text and "SkelRoot" in text
    expected = read_samples(clip, "/thick/Mesh")
    opened = usd_io.open_stage(output)
    mesh = usd_io.read_meshes(opened).meshes[0]
    assert mesh.skinned and mesh.times.tolist() == [1.0, 2.0]
    for time in (1.0, 2.0):
        assert np.abs(usd_io.read_frame(mesh, time) - expected[time]).max() < 1e-5
    assert read_report(tmp_path / "r.json")["settings"]["shapes"] is True


def test_blend_shapes_of_a_stage_keep_their_weights(shape_files, tmp_path):
    from pxr import Usd, UsdSkel

    rest, thick, shapes = shape_files
    face, output = tmp_path / "face.usda", tmp_path / "o.usda"
    assert run("transfer", rest, rest, "--poses", *shapes, "-o", face, "--shapes").code == 0
    stage = Usd.Stage.Open(str(face))
    animation = UsdSkel.Animation(stage.GetPrimAtPath("/rest/ShapeAnimation"))
    weights = animation.GetBlendShapeWeightsAttr()
    weights.Clear()
    weights.Set([0.0, 0.5], 3.0)
    weights.Set([1.0, 0.25], 4.5)
    stage.GetRootLayer().Save()
    hero = AuthoredMesh("/Hero/Tube", tube_polygons(), rest=tube_pose(0.0) * (1.3, 1.3, 1.0))
    write_animation(tmp_path / "hero.usda", hero)
    done = run("transfer", face, tmp_path / "hero.usda", "-o", output, "--shapes")
    assert done.code == 0, done
    opened = usd_io.open_stage(output)
    mesh = usd_io.read_meshes(opened).meshes[0]
    assert mesh.path == "/Hero/Tube" and mesh.skinned
    animation = UsdSkel.Animation(opened.stage.GetPrimAtPath("/Hero/ShapeAnimation"))
    values = animation.GetBlendShapeWeightsAttr()
    assert values.GetTimeSamples() == [3.0, 4.5]
    assert list(values.Get(4.5)) == [1.0, 0.25]
    # The blended target: offsets of both shapes by their weights.
    run("transfer", rest, thick, "--poses", *shapes, "-o", tmp_path / "clip.usda")
    full = read_samples(tmp_path / "clip.usda", "/thick/Mesh")
    blended = mesh.rest + (full[1.0] - mesh.rest) + 0.25 * (full[2.0] - mesh.rest)
    assert np.abs(usd_io.read_frame(mesh, 4.5) - blended).max() < 1e-5


def test_shapes_that_cannot_be_are_told(shape_files, stages, tmp_path):
    rest, thick, shapes = shape_files
    source, target, output = stages
    arguments = ("transfer", rest, thick, "--poses", *shapes, "--shapes", "-o")
    assert_fails(run("transfer", source, target, "--shapes", "-o", output), 3, "no blend shapes")
    assert_fails(run(*arguments, tmp_path / "o.obj"), 2, "need USD")
    assert_fails(run(*arguments, output, "--repair"), 2, "--repair", "--shapes")
    assert_fails(run(*arguments, output, "--pin", "a.npz"), 2, "--pin", "--shapes")
    assert_fails(run(*arguments, output, "--frames", "1"), 2, "--frames", "--shapes")
    assert_fails(run(*arguments[:3], "--poses", source, *arguments[-2:], output), 2, "mesh files")
    write_animation(tmp_path / "r.usda", AuthoredMesh("/Tube", tube_polygons(), rest=tube_pose(0)))
    alone = ("transfer", rest, tmp_path / "r.usda", "--poses", *shapes, "--shapes", "-o", output)
    assert_fails(run(*alone), 3, "put it under an Xform")
    assert not output.exists()
