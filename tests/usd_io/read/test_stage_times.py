"""Which frames of a stage are looked at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from tests.skinned_box import skinned_stage
from tests.usd_reading import edited_cube, selection_of
from tests.usd_stages import define_cube, new_stage
from usd_io import FrameSpecError, StageTimes, open_stage, parse_frames, read_meshes, stage_times


def times_of(path: Path, spec: str | None = None, **options: bool) -> StageTimes:
    meshes = read_meshes(open_stage(path)).meshes
    return stage_times(meshes, None if spec is None else parse_frames(spec), **options)


def two_cubes(path: Path, keys: tuple[float, ...] = (0.0, 5.0)) -> Path:
    """A still cube, and one that a transform with keys moves."""
    stage = new_stage(path)
    define_cube(stage, "/Root/Still")
    slide = define_cube(stage, "/Root/Moved").AddTranslateOp()
    for row, key in enumerate(keys):
        slide.Set((9.0 * row, 0.0, 0.0), key)
    stage.GetRootLayer().Save()
    return path


def test_whole_frames_between_keys_are_looked_at(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "a.usda", (0.0, 2.5, 5.0))
    assert times_of(path).every.tolist() == [0.0, 1.0, 2.0, 2.5, 3.0, 4.0, 5.0]
    assert times_of(path, "3").chosen.tolist() == [3.0]
    assert times_of(path, whole=False).every.tolist() == [0.0, 2.5, 5.0]
    assert times_of(path, authored=True).every.tolist() == [0.0, 2.5, 5.0]
    with pytest.raises(FrameSpecError, match="none of the frames, 0 to 5"):
        times_of(path, "6")


def test_of_one_mesh_the_transforms_do_not_matter(tmp_path: Path) -> None:
    def edit(cube: UsdGeom.Mesh) -> None:
        slide = cube.AddTranslateOp()
        for time in (0.0, 9.0):
            slide.Set((time, 0.0, 0.0), time)

    path = edited_cube(tmp_path, edit)
    found = times_of(path)
    assert np.isnan(found.every).all() and len(found.every) == 1 and not found.warnings


def test_sparse_points_are_looked_at_between_their_samples(tmp_path: Path) -> None:
    path = edited_cube(tmp_path, lambda cube: None, times=[1.0, 4.0])
    assert times_of(path).every.tolist() == [1.0, 2.0, 3.0, 4.0]
    assert times_of(path).keys.tolist() == [1.0, 4.0]


def test_ordinary_samples_are_the_frames_bit_for_bit(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage, times=np.arange(1.0, 6.0).tolist())
    stage.GetRootLayer().Save()
    outer = Sdf.Layer.CreateNew(str(tmp_path / "outer.usda"))
    outer.subLayerPaths = ["in.usda"]
    outer.subLayerOffsets[0] = Sdf.LayerOffset(0.1 + 0.2, 1.0 / 3.0 * 3.0)
    outer.Save()
    for path in (tmp_path / "in.usda", tmp_path / "outer.usda"):
        found = times_of(path)
        assert found.keys.tolist() == selection_of(path).meshes[0].times.tolist()
        assert set(found.keys.tolist()) <= set(found.every.tolist())
    assert times_of(tmp_path / "in.usda").every.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_of_skins_the_keys_are_all_frames_and_the_samples_the_authored_ones(
    tmp_path: Path,
) -> None:
    skinned_stage(tmp_path / "a.usda").Save()
    found = times_of(tmp_path / "a.usda")
    assert found.keys.tolist() == found.every.tolist() == list(range(31))
    assert times_of(tmp_path / "a.usda", authored=True).every.tolist() == [0.0, 30.0]


def test_frames_are_those_of_the_playback_rate(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "a.usda", keys={0.0: 0.0, 1000.0: 90.0})
    stage.SetTimeCodesPerSecond(4800.0)
    stage.SetFramesPerSecond(24.0)
    stage.GetRootLayer().Save()
    expected = [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0]
    assert times_of(tmp_path / "a.usda").every.tolist() == expected


def test_knots_of_splines_are_keys(tmp_path: Path) -> None:
    if not hasattr(Usd.Attribute, "SetSpline"):
        pytest.skip("this OpenUSD has no splines")
    from pxr import Ts

    path = two_cubes(tmp_path / "a.usda")
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Moved"))
    mesh.ClearXformOpOrder()
    operation = mesh.AddTranslateXOp()
    spline = Ts.Spline("double")
    for time in (2.0, 6.0):
        knot = Ts.Knot("double")
        knot.SetTime(time)
        knot.SetValue(time)
        spline.SetKnot(knot)
    operation.GetAttr().SetSpline(spline)
    stage.Save()
    assert times_of(path).every.tolist() == [2.0, 3.0, 4.0, 5.0, 6.0]


def test_a_key_far_off_leaves_the_keys_and_a_warning(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "a.usda", (0.0, 10.0, 1e9))
    found = times_of(path)
    assert found.every.tolist() == [0.0, 10.0, 1e9]
    assert len(found.warnings) == 1 and "only the 3 keys are looked at" in found.warnings[0]
    named = times_of(path, "3:4")
    assert named.chosen.tolist() == [3.0, 4.0] and not named.warnings
    assert named.every.tolist() == [0.0, 2.0, 3.0, 4.0, 5.0, 10.0, 1e9]
    assert times_of(path, "0:1e9").warnings


def test_a_skin_with_a_key_far_off_has_its_samples_only(tmp_path: Path) -> None:
    skinned_stage(tmp_path / "a.usda", keys={0.0: 0.0, 1e9: 90.0}).Save()
    (mesh,) = selection_of(tmp_path / "a.usda").meshes
    assert mesh.times.tolist() == [0.0, 1e9]


def test_frames_beside_others() -> None:
    every = np.array([0.0, 1.0, 2.0, 2.5, 3.0])
    times = StageTimes(every, every, every)
    assert times.beside([0.0, 2.0]) == {1.0, 2.5}
    assert times.beside([3.0]) == {2.5} and times.beside([]) == set()


def test_frames_outside_the_time_range_are_told(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "a.usda", (-2.0, 7.0))
    stage = Usd.Stage.Open(str(path))

    def told(start: float, end: float, spec: str | None = None) -> str:
        stage.SetStartTimeCode(start)
        stage.SetEndTimeCode(end)
        stage.GetRootLayer().Save()
        return " ".join(times_of(path, spec).warnings)

    assert times_of(path).warnings == ()  # a stage without a range
    assert "4 of 10 frames lie outside the time range of the stage, 0 to 5" in told(0.0, 5.0)
    assert "--frames 0:5" in told(0.0, 5.0)
    assert times_of(path, "0:5").chosen.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert told(0.0, 5.0, "0:5") == "" and told(-2.0, 7.0) == ""
    # A range with nothing in it was never set for this stage, nor one that ends before it begins.
    assert told(100.0, 200.0) == "" and told(5.0, 0.0) == ""


def test_frames_between_whole_ones_are_looked_at_where_they_are_meant(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "a.usda")
    found = times_of(path, "2.5")
    assert found.chosen.tolist() == [2.5] and found.beside([2.5]) == {2.0, 3.0}
    assert times_of(path, "3:4x0.5,1").chosen.tolist() == [1.0, 3.0, 3.5, 4.0]
    assert times_of(path, "0.5:3").chosen.tolist() == [0.5, 1.5, 2.5]
    with pytest.raises(FrameSpecError, match="none of the frames, 0 to 5"):
        times_of(path, "5.5")
    with pytest.raises(FrameSpecError, match="none of the frames, 0, 5, is"):
        times_of(path, "2.5", authored=True)


def test_a_frame_within_rounding_of_another_is_that_one(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "a.usda", (0.1 + 0.2, 5.0))
    assert times_of(path, "0.3,2.0000001").chosen.tolist() == [0.1 + 0.2, 2.0]
    assert times_of(path, "0.3,2.0000001").every.tolist() == times_of(path).every.tolist()
    assert len(times_of(path, "1:2x0.1,1.7,1.7000000001").chosen) == 11


def test_more_frames_than_can_be_looked_at_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FrameSpecError, match="more than 20000 frames"):
        times_of(two_cubes(tmp_path / "a.usda"), "1:4x0.0001")


def test_a_range_without_a_stride_is_of_the_frames_of_the_stage(tmp_path: Path) -> None:
    stage = skinned_stage(tmp_path / "a.usda", keys={0.0: 0.0, 1000.0: 90.0})
    stage.SetTimeCodesPerSecond(4800.0)
    stage.SetFramesPerSecond(24.0)
    stage.GetRootLayer().Save()
    assert times_of(tmp_path / "a.usda", "100:500").chosen.tolist() == [200.0, 400.0]
    assert times_of(tmp_path / "a.usda", "100:500x200").chosen.tolist() == [100.0, 300.0, 500.0]


def test_named_frames_without_a_sample_are_told(tmp_path: Path) -> None:
    path = two_cubes(tmp_path / "a.usda", (0.0, 2.0, 8.0))
    found = times_of(path, "0,1,2,5.5,9", authored=True)
    assert found.chosen.tolist() == [0.0, 2.0]
    left_out, beyond = found.warnings
    assert left_out.endswith("1, 5.5 are without a sample, and are left out")
    assert "go beyond" in beyond
    (one,) = times_of(path, "0:8x7,0:8x8", authored=True).warnings
    assert one.endswith(" 7 is without a sample, and is left out")
    # A range chooses among the samples, and without `authored` nothing is left out.
    assert not times_of(path, "0:8", authored=True).warnings
    assert not times_of(path, "0,1,5.5").warnings
    (many,) = times_of(path, "0:8x1e-7", authored=True).warnings
    assert many.endswith("those that are without a sample are left out")
