"""`dtrepair keyposes`: what is written, verified by `check` and USD itself, and how a run ends."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from dtrepair.report.record import read_report
from dtrepair.report.schema import ReportError, validate
from tests.command_line import (
    CLOSED,
    OPEN,
    Outcome,
    assert_fails,
    read_samples,
    run,
    tube_obj,
    tube_stage,
)
from tests.swinging_arm import arm_pose, arm_stage


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """The folder of a swing through the body, its repaired keys, and the report."""
    folder = tmp_path_factory.mktemp("swing")
    path = arm_stage(folder / "arm.usda", (1.0, -1.0, -0.8))
    report = folder / "r.json"
    done = run("keyposes", path, "-o", folder / "b.usdc", "--samples", 8, "--report", report)
    assert done.code == 0, done
    return folder, done


def in_betweens_by_usd(path: Path, count: int) -> list[NDArray[np.float32]]:
    """Points of the arm as USD interpolates them, `count` between any two keys."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    points = stage.GetPrimAtPath("/Root/Arm").GetAttribute("points")
    keys = points.GetTimeSamples()
    found = [
        np.array(points.Get(a + (b - a) * k / (count + 1)))
        for a, b in pairwise(keys)
        for k in range(1, count + 1)
    ]
    del points, stage
    return found


def test_all_in_betweens_are_clean_as_usd_interpolates_them(swing: tuple[Path, Outcome]) -> None:
    from dtrepair import find_intersections
    from tests.swinging_arm import arm_mesh

    folder, done = swing
    faces = arm_mesh(1.0)[1]
    before = in_betweens_by_usd(folder / "arm.usda", 8)
    assert any(len(find_intersections(points, faces)) for points in before)
    after = in_betweens_by_usd(folder / "b.usdc", 8)
    assert not any(len(find_intersections(points, faces)) for points in after)
    assert run("check", folder / "b.usdc").code == 0
    assert "in-betweens clean" in done.out and "added keys" in done.out
    # What the input had is another number: its keys are repaired first.
    assert "dirty with repaired keys" in done.out and "dirty in the output" in done.out
    (span, *_) = read_report(folder / "r.json")["keyposes"]["spans"]
    assert f"; with repaired keys alone {16 - span['before']['dirty']} of 16\n" in done.out


def test_given_keys_move_little_and_few_are_added(swing: tuple[Path, Outcome]) -> None:
    folder, _ = swing
    before, after = read_samples_of(folder / "arm.usda"), read_samples_of(folder / "b.usdc")
    diagonal = np.linalg.norm(np.ptp(before[1.0], axis=0))
    moves = [np.linalg.norm(after[t] - before[t], axis=1).max() / diagonal for t in before]
    assert max(moves) < 0.05 and moves.count(0.0) >= 1
    assert 1 <= len(after) - len(before) <= 3


def read_samples_of(path: Path) -> dict[float, NDArray[np.float32]]:
    return read_samples(path, "/Root/Arm")


def test_report_tells_spans_and_keys(swing: tuple[Path, Outcome]) -> None:
    folder, _ = swing
    report = read_report(folder / "r.json")
    assert report["command"] == "keyposes" and report["keyposes"]["interpolation"] == "linear"
    first, second = report["keyposes"]["spans"]
    assert (first["start"], first["end"]) == (1.0, 11.0)
    assert first["before"]["dirty"] == 4 and first["after"]["dirty"] == 0 == first["after"]["pairs"]
    assert first["left"] == [] and second["added"] == []
    added = [f for f in report["frames"] if f["message"] == "added key"]
    assert [f["time"] for f in added] == first["added"]
    assert added[0]["before"]["pairs"] > 0
    assert all(f["after"]["pairs"] == 0 for f in report["frames"])
    assert report["summary"]["frames"] == 3 + len(added)
    report["keyposes"]["spans"][0]["start"] = "x"
    with pytest.raises(ReportError, match=r"spans\[0\]\.start"):
        validate(report)


def test_verify_only_counts_and_writes_nothing(swing: tuple[Path, Outcome], tmp_path: Path) -> None:
    folder, _ = swing
    files = sorted(folder.iterdir())
    dirty = run("keyposes", folder / "arm.usda", "--verify-only", "--report", tmp_path / "r.json")
    assert dirty.code == 1 and "\nintersecting at" in dirty.out
    # Nothing was tried.
    assert "may do better" not in dirty.out and "repaired" not in dirty.out
    report = read_report(tmp_path / "r.json")
    assert report["output"] is None and report["keyposes"]["spans"][0]["before"]["dirty"] == 2
    clean = run("keyposes", folder / "b.usdc", "--verify-only", "--samples", 8)
    assert (clean.code == 0 and "24 of 24" in clean.out) or "32 of 32" in clean.out
    assert sorted(folder.iterdir()) == files
    cubic = run("keyposes", folder / "arm.usda", "--verify-only", "--interpolation", "cubic")
    assert cubic.code == 1


def test_an_output_and_none_exclude_each_other(tmp_path: Path) -> None:
    path, out = tube_stage(tmp_path / "a.usda", (OPEN, OPEN)), tmp_path / "b.usdc"
    assert_fails(run("keyposes", path, "-o", out, "--verify-only"), 2, "leave out -o")
    assert_fails(run("keyposes", path), 2, "name an output with -o")


def test_verify_only_tells_the_keys_that_intersect(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    done = run("keyposes", path, "--verify-only")
    assert done.code == 1 and "1 of 2 keys clean" in done.out
    header, row = done.out.splitlines()[:2]
    count = run("check", path, "--json", "-").json["frames"][1]["before"]
    assert header.split() == ["key", "triangles", "pairs"]
    assert row.split() == ["2", str(count["triangles"]), str(count["pairs"])]
    plan = run("keyposes", path, "--verify-only", "--dry-run")
    assert plan.code == 0 and "2 frames (1 to 2) would be counted" in plan.out


def test_dirty_keys_are_repaired_and_clean_ones_stay(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN), times=(-1, 0.5, 20))
    assert run("keyposes", path, "-o", tmp_path / "b.usdc").code == 0
    before, after = read_samples(path), read_samples(tmp_path / "b.usdc")
    assert set(before) <= set(after)
    same = [np.array_equal(before[time], after[time]) for time in before]
    assert same[0] and not same[1]
    assert run("keyposes", tmp_path / "b.usdc", "--verify-only").code == 0


def test_what_is_left_ends_with_1(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "arm.usda")
    done = run("keyposes", path, "-o", tmp_path / "b.usdc", "--extra-keys", 0, "--keep-keys")
    assert done.code == 1 and "2 of 4 in-betweens clean" in done.out
    assert "still intersecting at 5, 7; dtrepair repair, which solves" in done.out


def test_several_meshes_in_world_space(tmp_path: Path) -> None:
    # The keys of the moving tube are clean; between them it passes through the still one.
    from tests.meshes import tube_quads
    from usd_io import AuthoredMesh, write_animation

    points, quads = tube_quads(12, 16)
    moved = [points + np.array([x, 0.13, 0.0]) for x in (-1.0, 1.0)]
    meshes = [
        AuthoredMesh(path="/Root/Still/Tube", faces=quads, rest=points),
        AuthoredMesh(path="/Root/Moving/Tube", faces=quads, rest=moved[0], points=moved),
    ]
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=[1.0, 9.0])
    assert run("keyposes", path, "--verify-only").code == 1
    options = ["-o", tmp_path / "b.usdc", "--collider", "/Root/Still//"]
    assert run("keyposes", path, *options).code == 0
    assert run("keyposes", tmp_path / "b.usdc", "--verify-only").code == 0
    assert read_samples(tmp_path / "b.usdc", "/Root/Still/Tube") == {}
    assert len(read_samples(tmp_path / "b.usdc", "/Root/Moving/Tube")) > 2


@pytest.fixture
def bar_over_ball(tmp_path: Path) -> Path:
    """A bar, stretched by its parent, whose keys are clean; between them it runs into a ball."""
    from tests.meshes import icosphere
    from usd_io import AuthoredMesh, write_animation

    ball, faces = icosphere(2, radius=0.5)
    bar = ball * np.array([0.3, 0.3, 1.6])
    keys = [bar + np.array([x, 0.1, 0.4]) for x in (-1.0, 1.0)]
    stretch = np.diag([1.0, 2.0, 1.0, 1.0])
    still = [ball * np.array([1.0, 2.0, 1.0])] * 2
    meshes = [
        AuthoredMesh(path="/Ball/Mesh", faces=faces, points=still),
        AuthoredMesh(path="/Bar/Mesh", faces=faces, points=keys, transforms=stretch),
    ]
    path = tmp_path / "bar.usda"
    write_animation(path, meshes, times=[1.0, 9.0])
    return path


def test_a_rigid_mesh_keeps_its_shape_in_every_key(bar_over_ball: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.usdc"
    done = run("keyposes", bar_over_ball, "-o", out, "--rigid", "/Bar", "--collider", "/Ball//")
    assert done.code == 0, done
    before, after = read_samples(bar_over_ball, "/Bar/Mesh"), read_samples(out, "/Bar/Mesh")
    assert len(after) > len(before)
    world = np.array([1.0, 2.0, 1.0])

    def lengths(points: ArrayLike) -> NDArray[np.float64]:
        lengths: NDArray[np.float64] = np.linalg.norm(
            np.diff(np.asarray(points) * world, axis=0), axis=1
        )
        return lengths

    for points in after.values():
        assert np.allclose(lengths(points), lengths(before[1]), rtol=1e-4)


def test_ignored_contacts_need_no_keys(bar_over_ball: Path, tmp_path: Path) -> None:
    ignored = ("--ignore", "/Bar,/Ball")
    assert run("keyposes", bar_over_ball, "--verify-only").code == 1
    assert run("keyposes", bar_over_ball, "--verify-only", *ignored).code == 0
    out = tmp_path / "out.usdc"
    assert run("keyposes", bar_over_ball, "-o", out, *ignored).code == 0
    assert read_samples(out, "/Bar/Mesh").keys() == read_samples(bar_over_ball, "/Bar/Mesh").keys()


def test_selected_keys_and_unusable_ones(tmp_path: Path) -> None:
    from pxr import Usd

    path = arm_stage(tmp_path / "arm.usda", (1.0, -1.0, 1.0, 0.9))
    some = run("keyposes", path, "--verify-only", "--frames", "21:31")
    assert some.code == 0 and "4 of 4" in some.out
    apart = run("keyposes", path, "--verify-only", "--frames", "1,21")
    assert apart.code == 0 and "no in-betweens:" in apart.out  # key 11 lies between
    assert "no two neighbouring keys" in apart.err
    stage = Usd.Stage.Open(str(path))
    points = stage.GetPrimAtPath("/Root/Arm").GetAttribute("points")
    points.Set([(float("nan"), 0, 0)] * len(arm_pose(1.0)), 11)
    stage.Save()
    done = run("keyposes", path, "-o", tmp_path / "b.usdc")
    assert done.code == 4 and "2 spans with an unusable key" in done.err
    del points, stage


def test_dry_run_and_skip_existing(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "arm.usda")
    files = sorted(tmp_path.iterdir())
    plan = run("keyposes", path, "-o", tmp_path / "b.usdc", "--dry-run")
    assert plan.code == 0 and "2 frames (1 to 11)" in plan.out
    assert sorted(tmp_path.iterdir()) == files
    arm_stage(tmp_path / "b.usdc")
    again = run("keyposes", tmp_path / "no.usd", "-o", tmp_path / "b.usdc", "--skip-existing")
    assert again.code == 0 and "exists" in again.out


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["{usd}"], 2, ["-o OUT", "--verify-only"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--verify-only"], 2, ["--verify-only"]),
        (["{obj}", "-o", "{dir}/b.usdc"], 2, ["is not a USD stage"]),
        (["{still}", "-o", "{dir}/b.usdc"], 2, ["no mesh has time samples", "dtrepair repair"]),
        (["{usd}", "-o", "{usd}"], 2, ["part of the input stage"]),
        (["{usd}", "-o", "{dir}/b.usdc", "--samples", "0"], 2, ["--samples"]),
        (["{usd}", "-o", "{dir}/none/b.usdc"], 5, ["none"]),
        (["{dir}/none.usd", "--verify-only"], 3, ["no such file"]),
    ],
)
def test_errors_leave_no_file(
    tmp_path: Path, arguments: list[str], code: int, words: list[str]
) -> None:
    names = {
        "obj": str(tube_obj(tmp_path / "a.obj")),
        "usd": str(arm_stage(tmp_path / "a.usda")),
        "still": str(tube_stage(tmp_path / "s.usda", (), rest=CLOSED)),
        "dir": str(tmp_path),
    }
    before = sorted(tmp_path.iterdir())
    assert_fails(run("keyposes", *(text.format(**names) for text in arguments)), code, *words)
    assert sorted(tmp_path.iterdir()) == before
