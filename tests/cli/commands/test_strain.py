"""What strains a shape: kept within the bounds, told with frame, part and place, exit code 1."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from dtrepair.intersect.detector import find_intersections
from dtrepair.repair.surface.topology import Topology
from dtrepair.report.record import read_report
from tests.command_line import assert_fails, read_samples, run
from tests.meshes import armed_body

PRIM = "/Root/Body"


def pinned_arm(path: Path, curls: Sequence[float]) -> Path:
    """A stage of an arm that goes through its body; only what is next to the contact may move."""
    from pxr import Sdf, Usd, UsdGeom

    from usd_io import AuthoredMesh, write_animation

    points = [armed_body(curl)[0] for curl in curls]
    rest, faces = armed_body(0.0)
    free = np.zeros(len(rest), dtype=bool)
    for pose in points:
        free[faces[np.unique(find_intersections(pose, faces))]] = True
    free = Topology(faces, len(rest)).dilate(free)
    mesh = AuthoredMesh(path=PRIM, faces=faces, points=points, rest=rest)
    write_animation(path, mesh, times=np.arange(1.0, len(curls) + 1.0))
    stage = Usd.Stage.Open(str(path))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(PRIM))
    pin = primvars.CreatePrimvar("pin", Sdf.ValueTypeNames.FloatArray, "vertex")
    pin.Set((~free).astype(float).tolist())
    stage.Save()
    return path


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return pinned_arm(tmp_path / "a.usda", (3.0, 4.2))


def test_the_best_pose_within_the_bounds_is_kept_and_told(arm: Path, tmp_path: Path) -> None:
    out, told = tmp_path / "b.usdc", tmp_path / "r.json"
    done = run("repair", arm, "-o", out, "--pin", "pin", "--alone", "--report", told)
    assert done.code == 1 and "1 frame strained" in done.out
    (line,) = [line for line in done.out.splitlines() if line.startswith("strained: ")]
    assert line.startswith(f"strained: frame 2: {PRIM}, at (") and "turned over, at most" in line
    assert line.endswith("is kept; take what is strained with --at-any-cost")
    advice = [line for line in done.out.splitlines() if line.startswith("advice: ")]
    assert f"{PRIM} still intersects itself: not resolved within the bounds" in advice[0]
    report = read_report(told)
    first, second = report["frames"]
    assert (first["status"], second["status"]) == ("clean", "strained")
    assert report["summary"]["strained"] == 1 and report["summary"]["clean"] == 1
    assert 0 < second["after"]["pairs"] <= second["before"]["pairs"]
    (strain,) = second["left"]["strains"]
    assert strain["body"] == PRIM and strain["value"] > strain["bound"]
    place = read_samples(arm, PRIM)[2.0][strain["vertex"]]
    assert np.allclose(place, strain["place"], atol=1e-5)
    size = np.linalg.norm(np.ptp(read_samples(arm, PRIM)[2.0], axis=0))
    assert strain["size"] == second["prims"][0]["size"] == pytest.approx(size)
    wide = f"a patch {strain['value'] * size:.4g} ({100 * strain['value']:.3g} %) wide turned over"
    assert wide in line and wide in second["message"]
    assert run("check", out).code == 1
    page = tmp_path / "r.html"
    assert run("report", told, "-o", page, "--pictures", 0).code == 0
    text = page.read_text()
    assert "Strained beyond the bounds" in text and "frames strained" in text


def test_at_any_cost_the_clean_pose_is_taken_and_still_told(arm: Path, tmp_path: Path) -> None:
    config, told = tmp_path / "c.toml", tmp_path / "r.json"
    config.write_text("at-any-cost = true\n")
    outputs = [tmp_path / "b.usdc", tmp_path / "c.usdc"]
    ways: list[tuple[object, ...]] = [("--at-any-cost",), ("--config", config)]
    for out, way in zip(outputs, ways, strict=True):
        done = run("repair", arm, "-o", out, "--pin", "pin", "--alone", "--report", told, *way)
        assert done.code == 1 and "beyond the bounds, and kept all the same" in done.out
        second = read_report(told)["frames"][1]
        assert second["status"] == "strained" and second["after"]["pairs"] == 0
        assert run("check", out).code == 0
    assert read_report(told)["settings"]["at_any_cost"] is True
    assert_fails(
        run("repair", arm, "-o", tmp_path / "d.usdc", "--at-any-cost", "--method", "paper"),
        *(2, "--at-any-cost", "--method paper"),
    )


def test_key_poses_are_judged_too(tmp_path: Path) -> None:
    path, told = pinned_arm(tmp_path / "a.usda", (3.0, 4.2)), tmp_path / "r.json"
    arguments = ("--pin", "pin", "--samples", 1, "--keep-keys", "--extra-keys", 0)
    for way, pairs in (((), False), (("--at-any-cost",), True)):
        out = tmp_path / f"{pairs}.usdc"
        done = run("keyposes", path, "-o", out, *arguments, "--report", told, *way)
        assert done.code == 1 and "strained: frame 2: " in done.out
        second = read_report(told)["frames"][1]
        assert second["status"] == "strained" and (second["after"]["pairs"] == 0) == pairs
        (size,) = {strain["size"] for strain in second["left"]["strains"]}
        assert size == second["prims"][0]["size"] > 1
