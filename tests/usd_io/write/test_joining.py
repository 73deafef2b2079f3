from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt

from tests.usd_stages import (
    CUBE,
    authored_properties,
    cube_file,
    define_cube,
    moved_cube,
    new_stage,
    vec3f,
)
from usd_io import (
    OutputError,
    OverrideWriter,
    StageError,
    UsageError,
    join_layers,
    open_stage,
    read_frame,
    read_meshes,
)


def chunk(
    path: Path,
    output: Path,
    times: Iterable[float],
    *,
    change: float = 1.0,
    record: Mapping[str, Any] | None = None,
    version: str = "1",
    more: Mapping[str, Any] | None = None,
    **options: Any,
) -> Path:
    """A part of an animation: the frames given are changed."""
    opened, settings = open_stage(path), {"change": 1.0, **(record or {})}
    with OverrideWriter(opened, output, settings=settings, version=version) as writer:
        for mesh in read_meshes(opened, **options).meshes:
            for time in times:
                points = read_frame(mesh, time)
                assert points is not None
                writer.write(mesh, time, points + np.float32(change))
        writer.commit(record={"note": output.stem, **(more or {})})
    return output


def check_joined(output: Path, changed: Callable[[float], bool], times: Iterable[float]) -> None:
    stage = Usd.Stage.Open(str(output))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/Root/Cube")).GetPointsAttr()
    assert points.GetTimeSamples() == list(times)
    for time in times:
        expected = moved_cube(time) + np.float32(changed(time))
        assert np.asarray(points.Get(time)).tobytes() == expected.tobytes(), time


def test_four_chunks_make_one_layer(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(1, 41))
    chunks = [
        chunk(path, tmp_path / f"part{n}.usdc", range(10 * n + 1, 10 * n + 11)) for n in range(4)
    ]
    join_layers(chunks, tmp_path / "all.usdc")
    check_joined(tmp_path / "all.usdc", lambda time: True, range(1, 41))
    whole = chunk(path, tmp_path / "whole.usdc", range(1, 41))
    one, other = (Sdf.Layer.FindOrOpen(str(item)) for item in (tmp_path / "all.usdc", whole))
    assert authored_properties(tmp_path / "all.usdc") == authored_properties(whole)
    assert one.subLayerPaths == other.subLayerPaths == ["./in.usdc"]
    for key in ("timeCodesPerSecond", "defaultPrim"):
        assert one.pseudoRoot.GetInfo(key) == other.pseudoRoot.GetInfo(key)
    record = one.customLayerData["dtrepair"]
    assert list(record["frames"]) == list(range(1, 41))
    assert record["settings"] == {"change": 1.0} and record["version"] == "1"
    assert {record["chunks"][f"chunk{n}"]["note"] for n in range(4)} == {
        f"part{n}" for n in range(4)
    }


def test_frames_are_numbers_even_where_there_are_none(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(4))
    part = chunk(path, tmp_path / "part.usda", [])
    join_layers([part], tmp_path / "all.usda")
    for file in (part, tmp_path / "all.usda"):
        frames = Sdf.Layer.FindOrOpen(str(file)).customLayerData["dtrepair"]["frames"]
        assert isinstance(frames, Vt.DoubleArray) and len(frames) == 0


def test_frames_of_no_chunk_are_those_of_the_input(tmp_path: Path) -> None:
    times = [1.0, 1 / 3, 2.0, 3.0, 4.0]
    path = cube_file(tmp_path / "in.usda", times=times)
    first = chunk(path, tmp_path / "a.usdc", [1 / 3])
    second = chunk(path, tmp_path / "b.usda", [3.0, 4.0])
    join_layers([second, first], tmp_path / "all.usda")
    check_joined(tmp_path / "all.usda", lambda time: time in (1 / 3, 3.0, 4.0), sorted(times))


def test_the_order_of_the_chunks_does_not_matter(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(9))
    parts = [chunk(path, tmp_path / f"{n}.usdc", range(3 * n, 3 * n + 3)) for n in range(3)]
    results = set()
    for order in permutations(parts):
        join_layers(order, tmp_path / "all.usdc")
        results.add((tmp_path / "all.usdc").read_bytes())
    assert len(results) == 1


def test_a_joined_layer_can_be_joined_again(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(6))
    parts = [chunk(path, tmp_path / f"{n}.usdc", [2 * n, 2 * n + 1]) for n in range(3)]
    join_layers(parts[:2], tmp_path / "half.usdc")
    join_layers([tmp_path / "half.usdc", parts[2]], tmp_path / "all.usdc")
    check_joined(tmp_path / "all.usdc", lambda time: True, range(6))


def test_chunks_of_different_meshes(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    for name in ("A", "B"):
        define_cube(stage, f"/Root/{name}", times=[1.0, 2.0])
    stage.GetRootLayer().Save()
    parts = [
        chunk(tmp_path / "in.usda", tmp_path / f"{name}.usdc", [1.0, 2.0], prim=f"/Root/{name}")
        for name in ("A", "B")
    ]
    join_layers(parts, tmp_path / "all.usdc")
    assert authored_properties(tmp_path / "all.usdc") == {
        f"/Root/{name}.{attribute}" for name in "AB" for attribute in ("points", "extent")
    }


def test_equal_overlaps_are_fine_and_contradictions_are_not(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(6))
    first = chunk(path, tmp_path / "a.usdc", [0, 1, 2, 3])
    same = chunk(path, tmp_path / "b.usdc", [3, 4, 5])
    other = chunk(path, tmp_path / "c.usdc", [3, 4, 5], change=2.0)
    join_layers([first, same], tmp_path / "all.usdc")
    check_joined(tmp_path / "all.usdc", lambda time: True, range(6))
    with pytest.raises(StageError, match=r"disagree about /Root/Cube.\w+ at frame 3; give each"):
        join_layers([first, other], tmp_path / "bad.usdc")
    assert not (tmp_path / "bad.usdc").exists()


def test_an_input_that_changed_in_between_is_noticed(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda", times=range(4))
    first = chunk(path, tmp_path / "a.usdc", [0])
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.SetTimeSample("/Root/Cube.points", 3.0, vec3f(CUBE * 5))
    layer.Save()
    second = chunk(path, tmp_path / "b.usdc", [1])
    with pytest.raises(StageError, match="at frame 3; the inputs have changed"):
        join_layers([first, second], tmp_path / "all.usdc")
    layer.SetTimeSample("/Root/Cube.points", 2.0, Sdf.ValueBlock())
    layer.Save()
    third = chunk(path, tmp_path / "c.usdc", [3])
    with pytest.raises(StageError, match="at frame 2; the inputs have changed"):
        join_layers([second, third], tmp_path / "all.usdc")


def test_strangers_are_refused(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(4))
    own = {"list": [1, 2], "empty": [], "objects": {"/Root/Cube": {"rigid": True}}, "rest": "4"}
    split = [chunk(path, tmp_path / "a.usdc", [0], record={**own, "chunk": "1/2"})]
    split += [chunk(path, tmp_path / "b.usda", [1], record={**own, "chunk": "2/2"})]
    join_layers(split, tmp_path / "all.usdc")
    others: list[tuple[dict[str, Any], str]] = [
        ({"record": {**own, "chunk": "2/2", "change": 20.0}}, r"in change \(1.0 and 20.0\)"),
        ({"record": {**own, "chunk": "2/2", "frames": "2:3"}}, r"in frames \(none and 2:3\)"),
        ({"record": {**own, "chunk": "2/2", "list": [1, 3]}}, "in list"),
        ({"record": {**own, "chunk": "2/2"}, "version": "2"}, r"in version \(1 and 2\)"),
        ({"record": {**own, "chunk": "2/2"}, "more": {"input_digest": "f00d"}}, "the content of"),
        ({"record": {**own, "chunk": "2/2"}, "change": 5.0}, "disagree about"),
        ({"record": own}, "that only one is a chunk"),
    ]
    for options, words in others:
        times = [0, 1] if "change" in options else [1]
        other = chunk(path, tmp_path / "other.usdc", times, **options)
        for order in ([*split, other], [split[0], other]):
            with pytest.raises(
                StageError, match=words if len(order) > 2 else "missing|differ|disagree"
            ):
                join_layers(order, tmp_path / "bad.usdc", differing=["frames"])
    assert not (tmp_path / "bad.usdc").exists()


def test_ranges_may_differ_in_what_was_chosen(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=range(4))
    parts = [chunk(path, tmp_path / f"{n}.usdc", [n], record={"frames": str(n)}) for n in range(2)]
    with pytest.raises(StageError, match=r"in frames \(0 and 1\)"):
        join_layers(parts, tmp_path / "all.usdc")
    join_layers(parts, tmp_path / "all.usdc", differing=["frames"])
    check_joined(tmp_path / "all.usdc", lambda time: time < 2, range(4))


def test_different_inputs_are_refused(tmp_path: Path) -> None:
    first = chunk(cube_file(tmp_path / "a.usda", times=[1.0]), tmp_path / "a.usdc", [1.0])
    second = chunk(cube_file(tmp_path / "b.usda", times=[1.0]), tmp_path / "b.usdc", [1.0])
    with pytest.raises(StageError, match="lie over different inputs"):
        join_layers([first, second], tmp_path / "all.usdc")


def test_unusable_chunks_and_outputs(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda", times=[1.0])
    part = chunk(path, tmp_path / "a.usdc", [1.0])
    (tmp_path / "garbage.usdc").write_bytes(b"garbage" * 50)
    with pytest.raises(StageError, match=r"in.usda: was not written by a repair"):
        join_layers([path], tmp_path / "out.usdc")
    with pytest.raises(UsageError, match="no layers to join"):
        join_layers([], tmp_path / "all.usdc")
    for name in ("gone.usdc", "garbage.usdc"):
        with pytest.raises(StageError, match=name):
            join_layers([part, tmp_path / name], tmp_path / "all.usdc")
    before = part.read_bytes()
    for target in (part, path):
        with pytest.raises(UsageError, match="one of the inputs of the join"):
            join_layers([part], target)
    assert part.read_bytes() == before
    with pytest.raises(OutputError, match="no directory"):
        join_layers([part], tmp_path / "nowhere" / "all.usdc")


def test_default_points_blocks_and_bad_samples_come_through(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    points = define_cube(stage, times=[1.0, 4.0]).GetPointsAttr()
    points.Set(Sdf.ValueBlock(), 2.0)
    points.Set(vec3f(CUBE * np.nan), 3.0)
    define_cube(stage, "/Root/Still")
    stage.GetRootLayer().Save()
    first = chunk(tmp_path / "in.usda", tmp_path / "a.usdc", [1.0], prim="/Root/Cube")
    second = chunk(tmp_path / "in.usda", tmp_path / "b.usdc", [4.0], prim="/Root/Cube")
    still = chunk(tmp_path / "in.usda", tmp_path / "c.usdc", [float("nan")], prim="/Root/Still")
    join_layers([first, second, still], tmp_path / "all.usdc")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "all.usdc"))
    assert isinstance(layer.QueryTimeSample("/Root/Cube.points", 2.0), Sdf.ValueBlock)
    assert np.isnan(layer.QueryTimeSample("/Root/Cube.points", 3.0)).all()
    np.testing.assert_array_equal(layer.GetAttributeAtPath("/Root/Still.points").default, CUBE + 1)


def test_velocities_are_computed_across_the_seam(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "in.usda")
    cube = define_cube(stage, times=range(8))
    for time in range(8):
        cube.CreateVelocitiesAttr().Set(vec3f(CUBE * 77), time)
    stage.GetRootLayer().Save()
    parts = [
        chunk(tmp_path / "in.usda", tmp_path / "a.usdc", [0, 1, 2]),
        chunk(tmp_path / "in.usda", tmp_path / "b.usdc", [3, 4]),
    ]
    join_layers(parts, tmp_path / "all.usdc")
    chunk(tmp_path / "in.usda", tmp_path / "whole.usdc", range(5))
    joined, whole = (
        Sdf.Layer.FindOrOpen(str(tmp_path / name)) for name in ("all.usdc", "whole.usdc")
    )
    for time in range(8):
        np.testing.assert_array_equal(
            joined.QueryTimeSample("/Root/Cube.velocities", time),
            whole.QueryTimeSample("/Root/Cube.velocities", time),
        )


def test_expanded_instances_and_blocked_normals_come_through(tmp_path: Path) -> None:
    asset = new_stage(tmp_path / "asset.usda")
    cube = define_cube(asset, times=[1.0, 2.0])
    for time, count in ((1.0, 8), (2.0, 3)):
        cube.CreateNormalsAttr().Set(vec3f(CUBE[:count]), time)
    asset.GetRootLayer().Save()
    stage = new_stage(tmp_path / "in.usda")
    prim = UsdGeom.Xform.Define(stage, "/Root/A").GetPrim()
    prim.GetReferences().AddReference("./asset.usda")
    prim.SetInstanceable(True)
    stage.GetRootLayer().Save()
    parts = [
        chunk(tmp_path / "in.usda", tmp_path / f"{time}.usdc", [time], uninstance=True)
        for time in (1.0, 2.0)
    ]
    join_layers(parts, tmp_path / "all.usdc")
    out = Usd.Stage.Open(str(tmp_path / "all.usdc"))
    assert not out.GetPrimAtPath("/Root/A").IsInstance()
    assert not out.GetAttributeAtPath("/Root/A/Cube.normals").HasValue()
    points = out.GetAttributeAtPath("/Root/A/Cube.points")
    np.testing.assert_array_equal(points.Get(2.0), moved_cube(2.0) + 1)
