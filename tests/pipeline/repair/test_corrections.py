"""Corrections on the rig: what UsdSkel poses is what the repair found."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from dtrepair.pipeline import (
    CorrectionWritten,
    OutputOptions,
    RepairSettings,
    Selection,
    UsageError,
    check_stage,
    repair_stage,
)
from dtrepair.pipeline.repair import corrections, recount
from dtrepair.pipeline.stages.sources import open_source
from tests.command_line import run, tube_obj, tube_stage
from tests.pipeline.hosts import Listener
from tests.present import present
from tests.rigged_tube import MESH, POINTS, baked_points, rigged_tube, skinned_points
from tests.usd_reading import defined_in

SHAPES = OutputOptions(shapes=True)
SIZE = float(np.linalg.norm(np.ptp(POINTS, axis=0)))


def world_points(path: Path, time: float) -> NDArray[np.float64]:
    """World points of a mesh that no skeleton moves."""
    stage = Usd.Stage.Open(str(path))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(MESH))
    matrix = np.array(mesh.ComputeLocalToWorldTransform(time))
    points = np.asarray(mesh.GetPointsAttr().Get(time), dtype=np.float64)
    return np.asarray(points @ matrix[:3, :3] + matrix[3, :3])


FRAMES = np.arange(3.0, 10.0)


def moved(old: NDArray[np.float32], time: float, joint: float = 0.0) -> NDArray[np.float32]:
    """Posed points as a repair may leave them: a swelling that grows and travels, none elsewhere.

    joint: how far along each axis the joint lies from that of the first tube.
    """
    amount = 0.5 * np.sin(np.pi * (time - 2.0) / 8.0)
    place = np.abs(POINTS[:, 2] - 0.002 * time) / 0.25
    fade = np.maximum(1.0 - place, 0.0)[:, None] * (1.0 + 0.3 * np.sin(7.0 * POINTS[:, :1]))
    out = old + np.array([3.0, 0.0, 1.0]) + joint
    return np.where(fade > 0.0, old + amount * fade * out, old).astype(np.float32)


def written(stage: Path, output: Path, form: str) -> dict[tuple[float, str], Any]:
    """Give a sink the points of some frames; return them, by time and mesh."""
    source = open_source(str(stage), Selection())
    sink = corrections.CorrectionSink(source, str(output), {}, form)
    points = {}
    for time in FRAMES.tolist():
        for index, mesh in enumerate(source.meshes):
            points[time, mesh.path] = moved(present(source.read(mesh, time)), time, 5.0 * index)
            sink.put(index, time, points[time, mesh.path])
    sink.settle()
    assert sink.commit({}) == ()
    return points


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A bent tube with a blend shape of its own, corrected by shapes and by offsets."""
    folder = tmp_path_factory.mktemp("rig")
    stage = rigged_tube(folder / "in.usda", every=6.0, bulge=True, scale=2.0)
    files = {name: folder / f"{name}.usdc" for name in ("shapes", "offsets")}
    points = [written(stage, path, name) for name, path in files.items()]
    return {"in": stage, **files, "points": points[0]}


def world_of(points: NDArray[np.float32]) -> NDArray[np.float64]:
    """Points of the tube in the world."""
    return np.asarray(points + np.array([3.0, 0.0, 1.0]))


def test_the_rig_with_shapes_gives_the_points(results: dict[str, Any]) -> None:
    for time in np.arange(13.0):
        found = skinned_points(results["shapes"], time)
        if time in FRAMES:
            expected = world_of(results["points"][time, MESH])
            assert np.linalg.norm(found - expected, axis=1).max() <= 1e-4 * SIZE, time
            assert np.linalg.norm(found - skinned_points(results["in"], time), axis=1).max() > 0.01
        else:
            np.testing.assert_array_equal(found, skinned_points(results["in"], time))
    baked = baked_points(results["shapes"], 6.0)
    np.testing.assert_allclose(baked, skinned_points(results["shapes"], 6.0), atol=1e-5)


def test_between_the_frames_the_rig_moves_on(results: dict[str, Any]) -> None:
    # Points between two keys would be cut short by 2 % of the size: the shapes are not.
    for time in (4.5, 6.5):
        found, old = (skinned_points(results[name], time) for name in ("shapes", "in"))
        expected = moved((old - np.array([3.0, 0.0, 1.0])).astype(np.float32), time)
        assert np.abs(found - world_of(expected)).max() < 0.01
        ends = [world_of(results["points"][t, MESH]) for t in (time - 0.5, time + 0.5)]
        assert np.abs(found - np.mean(ends, axis=0)).max() > 0.01


def test_the_character_stays_bound_and_editable(results: dict[str, Any]) -> None:
    layer = Sdf.Layer.FindOrOpen(str(results["shapes"]))
    names: list[str] = []
    layer.Traverse("/", lambda path: names.append(str(path)))
    assert not any(name.endswith((".points", ".extent")) for name in names)
    stage = Usd.Stage.Open(layer)
    mesh = stage.GetPrimAtPath(MESH)
    assert mesh.HasAPI(UsdSkel.BindingAPI)
    binding = UsdSkel.BindingAPI(mesh)
    shapes = list(binding.GetBlendShapesAttr().Get())
    assert shapes[:2] == ["bulge", "repair_Tube_1"] and len(shapes) < 1 + len(FRAMES)
    targets = binding.GetBlendShapeTargetsRel().GetForwardedTargets()
    assert len(targets) == len(shapes)
    for target in targets[1:]:
        shape = UsdSkel.BlendShape(stage.GetPrimAtPath(target))
        offsets = np.asarray(shape.GetOffsetsAttr().Get())
        assert 0 < len(offsets) < 0.4 * len(POINTS) and offsets.any(axis=1).all()
        assert len(shape.GetPointIndicesAttr().Get()) == len(offsets)


def test_a_correction_can_be_dialled_down(results: dict[str, Any], tmp_path: Path) -> None:
    layer = Sdf.Layer.CreateNew(str(tmp_path / "half.usda"))
    layer.subLayerPaths = [str(results["shapes"])]
    stage = Usd.Stage.Open(layer)
    animation = UsdSkel.Animation(stage.GetPrimAtPath("/Root/Animation"))
    own = np.array([name.startswith("repair_") for name in animation.GetBlendShapesAttr().Get()])
    weights = np.asarray(animation.GetBlendShapeWeightsAttr().Get(6.0))
    animation.GetBlendShapeWeightsAttr().Set(np.where(own, 0.5 * weights, weights).tolist(), 6.0)
    stage.Save()
    old, new = (skinned_points(results[name], 6.0) for name in ("in", "shapes"))
    half = skinned_points(tmp_path / "half.usda", 6.0)
    np.testing.assert_allclose(half, 0.5 * (old + new), atol=1e-5 * SIZE)


def test_shapes_of_their_own_go_on_between_the_frames(results: dict[str, Any]) -> None:
    stages = [Usd.Stage.Open(str(results[name])) for name in ("in", "shapes")]
    animations = [UsdSkel.Animation(stage.GetPrimAtPath("/Root/Animation")) for stage in stages]
    before, after = (animation.GetBlendShapeWeightsAttr() for animation in animations)
    for time in np.arange(0.0, 12.1, 0.3):
        assert after.Get(time)[0] == pytest.approx(before.Get(time)[0], abs=1e-6)


def test_offsets_added_to_the_rig_give_the_points(results: dict[str, Any]) -> None:
    stage = Usd.Stage.Open(str(results["offsets"]))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(MESH))
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("dtrepair:offset")
    assert primvar.GetInterpolation() == "vertex" and primvar.IsIndexed()
    assert len(primvar.Get(6.0)) < 0.4 * len(POINTS)
    for time in np.arange(13.0):
        old = skinned_points(results["in"], time)
        np.testing.assert_array_equal(skinned_points(results["offsets"], time), old)
        offsets = np.asarray(primvar.ComputeFlattened(time), dtype=np.float64)
        if time in FRAMES:
            expected = world_of(results["points"][time, MESH])
            np.testing.assert_allclose(old + offsets, expected, atol=2e-6)
        else:
            assert not offsets.any()


def test_several_meshes_share_an_animation(tmp_path: Path) -> None:
    paths = [f"/Root/{name}" for name in ("Tube", "Other")]
    stage = rigged_tube(tmp_path / "in.usda", every=6.0, names=("Tube", "Other"))
    points = written(stage, tmp_path / "out.usdc", "shapes")
    for number, path in enumerate(paths):
        found = skinned_points(tmp_path / "out.usdc", 5.0, path)
        expected = world_of(points[5.0, path]) + 5.0 * number
        assert np.linalg.norm(found - expected, axis=1).max() <= 1e-4 * SIZE
    opened = Usd.Stage.Open(str(tmp_path / "out.usdc"))
    animation = UsdSkel.Animation(opened.GetPrimAtPath("/Root/Animation"))
    names = list(animation.GetBlendShapesAttr().Get())
    assert len(set(names)) == len(names)
    assert {name.rsplit("_", 1)[0] for name in names} == {"repair_Tube", "repair_Other"}


def test_a_skeleton_without_animation_gets_one(tmp_path: Path) -> None:
    from tests.pipeline.stages.test_between_keys import passing_balls

    stage = rigged_tube(tmp_path / "in.usda", angles=(100.0,))
    edited = Usd.Stage.Open(str(stage))
    edited.RemovePrim("/Root/Animation")
    skeleton = UsdSkel.BindingAPI(edited.GetPrimAtPath("/Root/Skeleton"))
    skeleton.GetAnimationSourceRel().ClearTargets(True)
    edited.Save()
    still = passing_balls(tmp_path / "still.usda")
    for path, meshes in ((stage, [MESH]), (still, ["/Root/Still", "/Root/Moved"])):
        source = open_source(str(path), Selection())
        output = tmp_path / f"{path.stem}_out.usda"
        sink = corrections.CorrectionSink(source, str(output), {}, "shapes")
        times = source.times.tolist()
        wanted = {}
        for index, mesh in enumerate(source.meshes):
            assert mesh.path == meshes[index]
            for time in times[:3]:
                wanted[index, time] = present(source.read(mesh, time)) * np.float32(1.01)
                sink.put(index, time, wanted[index, time])
        sink.commit({})
        assert all(defined_in(output).values())
        for (index, time), points in wanted.items():
            result = open_source(str(output), Selection())
            found = present(result.read(result.meshes[index], time))
            np.testing.assert_allclose(found, points, atol=1e-4)


def test_a_repair_tells_what_it_writes_and_poses_clean(tmp_path: Path) -> None:
    stage, output = rigged_tube(tmp_path / "in.usda", every=2.0), tmp_path / "out.usdc"
    host = Listener()
    report = repair_stage(stage, output, writing=SHAPES, jobs=1, observer=host)
    (told,) = [remark for remark in host.remarks if isinstance(remark, CorrectionWritten)]
    assert told.form == "shapes" and told.bytes == output.stat().st_size
    assert 0 < told.shapes <= 5 and 0 < told.vertices <= len(POINTS) and told.error <= 1e-4
    assert report.settings["shapes"] is True and "delta" not in report.settings
    assert RepairSettings.from_report(report.settings).writing == SHAPES
    assert "unchanged" in {frame.status for frame in check_stage(stage).frames}
    assert {frame.status for frame in check_stage(output).frames} == {"clean"}
    repair_stage(stage, tmp_path / "points.usdc", jobs=1)
    for time in np.arange(5.0):
        found, expected = skinned_points(output, time), world_points(tmp_path / "points.usdc", time)
        assert np.linalg.norm(found - expected, axis=1).max() <= 1e-4 * SIZE, time


def test_what_comes_too_near_again_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # With a tolerance that nobody would take no correction is left of most frames.
    coarse = partial(recount.RecountOptions, tolerances=(1.0,), rounds=0)
    monkeypatch.setattr(recount, "RecountOptions", coarse)
    stage, output = rigged_tube(tmp_path / "in.usda", every=2.0), tmp_path / "out.usdc"
    host = Listener()
    report = repair_stage(stage, output, writing=SHAPES, jobs=1, observer=host)
    found = check_stage(output)
    assert [f.after for f in report.frames] == [f.after for f in found.frames]
    assert any(frame.status != "clean" for frame in report.frames)
    assert any("intersect again" in warning for warning in host.warnings)


def test_offsets_are_of_frames_and_no_setting_that_is_unknown(tmp_path: Path) -> None:
    stage = rigged_tube(tmp_path / "in.usda", every=2.0, names=("Tube", "Other"))
    output, host = tmp_path / "out.usdc", Listener()
    repair_stage(stage, output, writing=OutputOptions(delta=True), jobs=1, observer=host)
    (done,) = (remark for remark in host.remarks if isinstance(remark, CorrectionWritten))
    layer = Sdf.Layer.FindOrOpen(str(output))
    names = [f"/Root/{name}.primvars:dtrepair:offset" for name in ("Tube", "Other")]
    times = [set(layer.ListTimeSamplesForPath(name)) for name in names]
    assert all(times) and done.shapes == len(times[0] | times[1])
    checked = Listener()
    check_stage(output, observer=checked)
    assert not any("unknown" in warning for warning in checked.warnings)


def test_what_cannot_be_is_refused_at_once(tmp_path: Path) -> None:
    stage = rigged_tube(tmp_path / "in.usda")
    cache = tube_stage(tmp_path / "cache.usda", (0.5, 6.0))
    output = tmp_path / "out.usda"
    with pytest.raises(UsageError, match="leave one out"):
        OutputOptions(shapes=True, delta=True)
    with pytest.raises(UsageError, match="--chunk: not with --shapes"):
        RepairSettings(writing=SHAPES, chunk="1/2")
    for arguments, words in (
        ((stage, "--shapes", "--distributed", "local"), "--distributed: not with --shapes"),
        ((tube_obj(tmp_path / "a.obj"), "--shapes"), "only for USD stages"),
        ((stage, "--delta", "-o", tmp_path / "b.obj"), "the output is a layer"),
        ((cache, "--shapes"), "points are animated"),
    ):
        done = run("repair", "-o", output, *arguments)
        assert done.code in (2, 3) and words in done.err and not output.exists()
    done = run("repair", cache, "-o", output, "--delta")
    assert done.code == 0 and "offsets of" in done.err and "kB" in done.err


def test_layers_of_corrections_are_not_joined(tmp_path: Path) -> None:
    written(rigged_tube(tmp_path / "in.usda", every=6.0), tmp_path / "a.usda", "offsets")
    done = run("join", tmp_path / "a.usda", "-o", tmp_path / "b.usda")
    assert done.code == 3 and "holds offsets" in done.err
