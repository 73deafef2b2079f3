"""Inputs of which some meshes or frames cannot be placed in the world."""

from __future__ import annotations

from pathlib import Path

import pytest
from pxr import Gf, UsdGeom, Vt

from dtrepair.pipeline.check import check_stage
from dtrepair.pipeline.errors import FRAMES, INPUT, InputError, UsageError, exit_code, plain_error
from dtrepair.pipeline.repair.stage import repair_stage
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.sources import open_source, placing_time
from tests.usd_stages import define_cube, new_stage
from usd_io import FrameError

BAD = [float("nan"), float("inf"), 1e300]


def two_cubes(path: Path, places: dict[float | None, float]) -> Path:
    """Two cubes, the second one moved along x, at times (None: the default time)."""
    stage = new_stage(path)
    define_cube(stage, "/Root/A")
    operation = UsdGeom.Xformable(define_cube(stage, "/Root/B")).AddTranslateOp()
    for time, place in places.items():
        value = Gf.Vec3d(place, 0.25, 0.5)
        operation.Set(value) if time is None else operation.Set(value, time)
    stage.GetRootLayer().Save()
    return path


@pytest.mark.parametrize("value", BAD)
@pytest.mark.parametrize("first", [True, False])
def test_a_transform_that_is_no_number_is_the_fault_of_its_frame(
    tmp_path: Path, value: float, first: bool
) -> None:
    places: dict[float | None, float] = {1.0: 5.0, 2.0: 5.0, 1.0 if first else 2.0: value}
    report = check_stage(two_cubes(tmp_path / "in.usda", {**places, 3.0: 1.0}))
    records = {record.time: record for record in report.frames}
    bad, good = (1.0, 2.0) if first else (2.0, 1.0)
    assert records[bad].status == "failed" and "/Root/B at frame" in records[bad].message
    assert records[good].status == "clean"
    counts = records[3.0].before
    assert counts is not None and counts.inter_pairs > 0
    assert exit_code(report) == FRAMES


@pytest.mark.parametrize("value", BAD)
def test_transforms_that_are_never_numbers_are_an_error_of_the_input(
    tmp_path: Path, value: float
) -> None:
    path = two_cubes(tmp_path / "in.usda", {None: value})
    for run in (check_stage, lambda path: repair_stage(path, tmp_path / "out.usdc")):
        with pytest.raises(InputError, match="no frame could be used: /Root/B") as caught:
            run(path)
        assert caught.value.exit_code == INPUT
    assert not (tmp_path / "out.usdc").exists()


def test_one_mesh_needs_no_place(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "in.usda", {None: float("nan")})
    report = check_stage(path, selection=Selection(prim="/Root/B"))
    assert [record.status for record in report.frames] == ["clean"]


def test_points_that_a_scale_takes_out_of_the_range_are_told(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage, "/Root/A")
    mesh = define_cube(stage, "/Root/B")
    mesh.GetPointsAttr().Set(Vt.Vec3fArray([value * 1e10 for value in mesh.GetPointsAttr().Get()]))
    UsdGeom.Xformable(mesh).AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(1e30))
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match="/Root/B at the default time: points leave the range"):
        check_stage(tmp_path / "in.usda")


@pytest.mark.parametrize("expression", [None, "/Root/M"])
def test_a_stage_with_empty_meshes_only_is_unusable(tmp_path: Path, expression: str | None) -> None:
    stage = new_stage(tmp_path / "in.usda")
    mesh = UsdGeom.Mesh.Define(stage, "/Root/M")
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    stage.GetRootLayer().Save()
    with pytest.raises(InputError, match="no points") as caught:
        check_stage(tmp_path / "in.usda", selection=Selection(prim=expression))
    assert caught.value.exit_code == INPUT
    with pytest.raises(UsageError, match="no usable mesh"):
        check_stage(tmp_path / "in.usda", selection=Selection(prim="/Root//"))


def test_rests_are_placed_at_the_first_time_that_serves(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "in.usda", {1.0: float("nan"), 2.0: 5.0, 3.0: 6.0})
    source = open_source(str(path), Selection())
    assert placing_time(source, source.times) == 2.0
    assert placing_time(source, [3.0, 2.0]) == 3.0


def test_a_frame_that_ends_a_run_is_an_error_of_the_input() -> None:
    # Exit code 4 says that the rest is written.
    error = plain_error(FrameError("/A", 1.0, "bad"))
    assert isinstance(error, InputError) and error.exit_code == INPUT
