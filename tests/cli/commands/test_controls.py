"""`dtrepair repair` of one mesh with pins, limits, clearance and directions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.command_line import (
    CLOSED,
    OPEN,
    assert_fails,
    read_samples,
    run,
    tube_obj,
    tube_stage,
)


def add_pin(path: Path, values: Sequence[float] | NDArray[np.float64], name: str = "pin") -> None:
    from pxr import Sdf, Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Root/Tube"))
    primvars.CreatePrimvar(name, Sdf.ValueTypeNames.FloatArray, "vertex").Set(values)
    stage.Save()


def test_pinned_vertices_keep_every_bit(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    fixed = np.arange(200) < 100  # one half of the tube
    add_pin(path, fixed.astype(float).tolist())
    out = tmp_path / "b.usdc"
    assert run("repair", path, "-o", out, "--pin", "pin").code == run("check", out).code
    before, after = read_samples(path)[2], read_samples(out)[2]
    assert np.array_equal(before[fixed], after[fixed])
    assert not np.array_equal(before[~fixed], after[~fixed])


def test_bad_pins_are_refused(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    add_pin(path, [3.0] * 200)
    out = tmp_path / "b.usdc"
    assert_fails(run("repair", path, "-o", out, "--pin", "pin"), 3, "from 0 to 1")
    assert_fails(run("repair", path, "-o", out, "--pin", "pen"), 2, "--pin pen", "GeomSubset")
    mesh = tube_obj(tmp_path / "a.obj")
    assert_fails(run("repair", mesh, "-o", tmp_path / "b.obj", "--pin", "p"), 2, "USD stages")
    assert not out.exists()


def largest_move(path: Path, out: Path, time: float = 2) -> float:
    """Largest distance a vertex of the tube moved at a time, in its own units."""
    before, after = read_samples(path)[time], read_samples(out)[time]
    return float(np.linalg.norm(after - before, axis=1).max())


def test_maximum_displacement_is_kept_in_stage_units(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    stretch(path, 10.0)
    out = tmp_path / "b.usdc"
    assert run("repair", path, "-o", out, "--alone").code == 0
    free = largest_move(path, out)
    limit = 5.0 * free  # half of it, as the parent stretches by ten
    code = run("repair", path, "-o", out, "--alone", "--maximum-displacement", limit).code
    assert code == run("check", out).code
    assert largest_move(path, out) <= limit / 10 * (1 + 1e-5)


def stretch(path: Path, factor: float) -> None:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    UsdGeom.Xformable(stage.GetPrimAtPath("/Root")).AddScaleOp().Set((factor,) * 3)
    stage.Save()


def gap(points: NDArray[Any]) -> float:
    """Smallest distance between vertices of the two ends of the tube."""
    first, last = points[:40], points[-40:]
    return float(np.linalg.norm(first[:, None] - last[None], axis=2).min())


@pytest.mark.parametrize("alone", [["--alone"], []])
def test_clearance_opens_the_gap(tmp_path: Path, alone: list[str]) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    gaps = []
    for clearance in ("0", "0.03"):
        out = tmp_path / f"b{clearance}.usdc"
        assert run("repair", path, "-o", out, *alone, "--clearance", clearance).code == 0
        gaps.append(gap(read_samples(out)[2]))
    assert gaps[1] > max(gaps[0], 0.025)


def test_a_clearance_beyond_all_measure_is_refused_in_stage_units(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    stage = Usd.Stage.Open(str(path))
    UsdGeom.Xformable(stage.GetPrimAtPath("/Root")).AddScaleOp().Set((10.0,) * 3)
    stage.Save()
    outcome = run("repair", path, "-o", tmp_path / "b.usdc", "--clearance", "90")
    told = re.search(r"error: --clearance 90: expected at most ([\d.]+), a twent", outcome.err)
    assert outcome.code == 2 and told is not None and "internal" not in outcome.err
    size = 10.0 * float(np.linalg.norm(np.ptp(read_samples(path)[1], axis=0)))
    assert 0.02 * size < float(told[1]) < 0.1 * size


@pytest.mark.parametrize("alone", [["--alone"], [], ["--method", "paper", "--iterations", "3"]])
def test_direction_leads_the_way(tmp_path: Path, alone: list[str]) -> None:
    from pxr import Sdf, Usd, UsdGeom

    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    stage = Usd.Stage.Open(str(path))
    tube = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Tube"))
    UsdGeom.Subset.CreateGeomSubset(tube, "end", "point", list(range(60)))
    primvars = UsdGeom.PrimvarsAPI(tube)
    kind = Sdf.ValueTypeNames.Vector3fArray
    primvars.CreatePrimvar("way", kind, "constant").Set([(0, 1, 0)])
    stage.Save()
    del tube, primvars, stage
    lifted = []
    for direction in ("end=0,1,0", "end=0,-1,0"):
        out = tmp_path / "b.usdc"
        run("repair", path, "-o", out, *alone, "--direction", direction)
        lifted.append(float((read_samples(out)[2] - read_samples(path)[2])[:60, 1].mean()))
    assert lifted[0] > 0 > lifted[1]
    assert run("repair", path, "-o", out, *alone, "--direction", "way").code in (0, 1)
    for wrong in ("end=1,2", "end=a,b,c", "end=0,0,0", "nobody", "nobody=0,1,0"):
        done = run("repair", path, "-o", out, *alone, "--direction", wrong)
        assert_fails(done, 2, "--direction")


@pytest.mark.parametrize(
    "option", [("--clearance", 0.1), ("--maximum-displacement", 1), ("--layer", "/Root/Tube=1")]
)
def test_options_without_effect_are_refused(tmp_path: Path, option: tuple[str, object]) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    out = ["-o", tmp_path / "b.usdc"]
    paper = run("repair", path, *out, *option, "--method", "paper")
    assert_fails(paper, 2, option[0], "--method paper")


def test_rest_contacts_can_be_left(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (CLOSED,), rest=CLOSED)
    out = tmp_path / "b.usdc"
    left = run("repair", path, "-o", out, "--rest-contacts", "leave")
    assert left.code == 1 and largest_move(path, out, 1) == 0.0
    assert run("repair", path, "-o", out, "--rest-contacts", "repair").code == 0
