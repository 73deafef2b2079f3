"""The view of a stage that the commands work with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.sources import open_source
from tests.command_line import CLOSED, OPEN, read_samples, run, tube_polygons, tube_pose, tube_stage
from tests.present import present

FAR = (1e7, -3e6, 12.5)


def two_tubes(path: Path, offset: tuple[float, float, float]) -> Path:
    """A stage of a tube that closes, and a still one beside it, far out or not."""
    from pxr import Usd, UsdGeom, Vt

    tube_stage(path, (OPEN, CLOSED))
    stage = Usd.Stage.Open(str(path))
    other = UsdGeom.Mesh.Define(stage, "/Root/Still")
    pose = (0.5 * tube_pose(OPEN) + [0.0, 0.0, 1.0]).astype(np.float32)
    other.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(pose))
    other.CreateFaceVertexCountsAttr([4] * len(tube_polygons()))
    other.CreateFaceVertexIndicesAttr(tube_polygons().reshape(-1).tolist())
    UsdGeom.Xformable(stage.GetPrimAtPath("/Root")).AddTranslateOp().Set(offset)
    stage.Save()
    return path


@pytest.fixture
def near_and_far(tmp_path: Path) -> list[Path]:
    return [two_tubes(tmp_path / f"{n}.usda", at) for n, at in (("n", (0, 0, 0)), ("f", FAR))]


def test_a_scene_far_from_the_origin_is_counted_and_repaired_as_a_near_one(
    near_and_far: list[Path],
) -> None:
    near, far = near_and_far
    counts = [run("check", path, "--json", "-").json["summary"] for path in near_and_far]
    # Where the parts are is told in the world.
    places = [own.pop("faults") for own in counts]
    assert places[0] != places[1] and len(places[0]["listed"]) == len(places[1]["listed"])
    assert counts[0] == counts[1] and counts[0]["triangles_before"] > 0
    assert "far from the world's origin" in run("check", far).err
    assert "far from" not in run("check", near).err
    results = []
    for path in near_and_far:
        output = path.with_suffix(".usdc")
        assert run("repair", path, "-o", output).code == 0
        results.append(read_samples(output)[2.0])
    # float64 at 1e7 has steps of 2e-9, float32 at 1 of 6e-8.
    near_result, far_result = results
    assert np.allclose(near_result, far_result, rtol=0.0, atol=1e-4)


def test_world_points_of_a_far_scene_lie_about_its_middle(near_and_far: list[Path]) -> None:
    source = open_source(str(near_and_far[1]), Selection())
    mesh = source.meshes[0]
    points = present(source.read(mesh, 1.0))
    world = source.to_world(mesh, 1.0, points)
    assert np.abs(world).max() < 10.0
    shift = world - points.astype(np.float64)
    assert np.allclose(shift, shift[0], atol=1e-8)
    assert np.allclose(source.to_local(mesh, 1.0, world), points, atol=1e-8)
