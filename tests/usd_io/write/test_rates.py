from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from tests.usd_stages import CUBE, authored_properties, define_cube, new_stage, vec3f
from usd_io import OverrideWriter, open_stage, read_meshes

TIMES = [1.0, 2.0, 3.5, 4.0, 5.0, 6.0, 7.0]
RATE = 48.0
STALE = np.full((8, 3), 77.0)


def parabola(time: float) -> NDArray[np.float64]:
    """Points of constant acceleration, in time codes."""
    return CUBE + 0.25 * time**2 * np.array([1.0, 2.0, -1.0]) + time


def moving_cube(
    tmp_path: Path,
    written: Sequence[float],
    points: Callable[[float], NDArray[np.float64]] = parabola,
    times: Sequence[float] = TIMES,
) -> Usd.Stage:
    """A cube with stale rates everywhere, some of its frames written anew."""
    stage = new_stage(tmp_path / "in.usda")
    stage.SetTimeCodesPerSecond(RATE)
    cube = define_cube(stage)
    for time in times:
        cube.GetPointsAttr().Set(vec3f(points(time)), time)
        cube.CreateVelocitiesAttr().Set(vec3f(STALE), time)
        cube.CreateAccelerationsAttr().Set(vec3f(STALE), time)
    if not len(times):
        cube.CreateVelocitiesAttr().Set(vec3f(STALE))
        cube.CreateAccelerationsAttr().Set(vec3f(STALE))
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    mesh = read_meshes(opened).meshes[0]
    with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
        for time in written:
            writer.write(mesh, time, points(time) if time == time else CUBE)
        writer.commit()
    return Usd.Stage.Open(str(tmp_path / "out.usdc"))


def test_rates_are_per_second_and_exact_for_a_parabola(tmp_path: Path) -> None:
    stage = moving_cube(tmp_path, TIMES)
    velocities = stage.GetAttributeAtPath("/Root/Cube.velocities")
    accelerations = stage.GetAttributeAtPath("/Root/Cube.accelerations")
    assert velocities.GetTimeSamples() == TIMES
    for time in TIMES[1:-1]:
        speed = (0.5 * time * np.array([1.0, 2.0, -1.0]) + 1.0) * RATE
        # Points are rounded to float32: 4e-6 of an acceleration over half a time code.
        np.testing.assert_allclose(velocities.Get(time), np.tile(speed, (8, 1)), rtol=1e-4)
        change = 0.5 * np.array([1.0, 2.0, -1.0]) * RATE**2
        np.testing.assert_allclose(accelerations.Get(time), np.tile(change, (8, 1)), rtol=1e-4)
    first = (parabola(2.0) - parabola(1.0)) * RATE
    np.testing.assert_allclose(velocities.Get(1.0), first, rtol=1e-4)
    assert accelerations.Get(1.0) is None, "stale at the end"
    assert authored_properties(tmp_path / "out.usdc") == {
        f"/Root/Cube.{name}" for name in ("points", "extent", "velocities", "accelerations")
    }


def test_untouched_stretches_keep_their_rates(tmp_path: Path) -> None:
    stage = moving_cube(tmp_path, [2.0])
    velocities = stage.GetAttributeAtPath("/Root/Cube.velocities")
    for time in TIMES:
        stale = np.array_equal(velocities.Get(time), STALE)
        assert stale == (time > 3.5), time


def test_neighbours_that_are_no_use_block_the_rate(tmp_path: Path) -> None:
    def gap(time: float) -> NDArray[np.float64]:
        return parabola(time)[:5] if time == 3.5 else parabola(time)

    stage = moving_cube(tmp_path, [5.0, 2.0], gap)
    velocities = stage.GetAttributeAtPath("/Root/Cube.velocities")
    assert velocities.Get(2.0) is None and velocities.Get(4.0) is None
    assert velocities.Get(6.0) is not None


def test_one_sample_has_no_rate(tmp_path: Path) -> None:
    stage = moving_cube(tmp_path, [1.0], times=[1.0])
    assert stage.GetAttributeAtPath("/Root/Cube.velocities").Get(1.0) is None


def test_rates_of_static_points_are_blocked(tmp_path: Path) -> None:
    stage = moving_cube(tmp_path, [float("nan")], times=[])
    for name in ("velocities", "accelerations"):
        attribute = stage.GetAttributeAtPath(f"/Root/Cube.{name}")
        assert not attribute.HasValue()
        layer = stage.GetRootLayer()
        assert isinstance(layer.GetAttributeAtPath(attribute.GetPath()).default, Sdf.ValueBlock)


def test_rates_the_input_does_not_have_are_not_made_up(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    define_cube(stage, times=TIMES)
    stage.GetRootLayer().Save()
    opened = open_stage(tmp_path / "in.usda")
    with OverrideWriter(opened, tmp_path / "out.usdc", settings={}) as writer:
        writer.write(read_meshes(opened).meshes[0], 1.0, CUBE)
        writer.commit()
    assert "/Root/Cube.velocities" not in authored_properties(tmp_path / "out.usdc")
