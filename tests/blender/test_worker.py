"""The worker as Blender starts it, without Blender."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from blender.dtrepair_addon.host.exchange import (
    Request,
    SampledMesh,
    read_pairs,
    read_points,
    read_request,
    write_request,
)
from blender.dtrepair_addon.host.process import Worker, WorkerError
from blender.dtrepair_addon.worker.stage import prim_paths
from tests.meshes import crossing_tubes

PYTHON = Path(sys.executable)


def request(command: str, name: str = "Two tubes") -> Request:
    """Tubes that cross in the second of two frames only, away from the origin."""
    points, faces = crossing_tubes(8, 10)
    half = len(points) // 2
    apart = points + np.where(np.arange(len(points)) < half, 0.0, 2.0)[:, None]
    poses = np.stack([apart, points]).astype(np.float32)
    place = np.eye(4)
    place[:3, 3] = 3.0, -1.0, 0.5
    counts = np.full(len(faces), 3, np.int32)
    mesh = SampledMesh(name, counts, faces.ravel(), poses, np.stack([place] * 2), poses[0], place)
    return Request(command, (4, 5), (mesh,), {"alone": True})


def test_a_request_comes_back_bit_for_bit(tmp_path: Path) -> None:
    asked = request("check")
    pin = np.linspace(0, 1, asked.meshes[0].points.shape[1]).astype(np.float32)
    asked = dataclasses.replace(asked, meshes=(dataclasses.replace(asked.meshes[0], pin=pin),))
    write_request(tmp_path, asked)
    back = read_request(tmp_path)
    assert (back.command, back.frames, back.settings) == ("check", (4, 5), {"alone": True})
    for name, value in vars(asked.meshes[0]).items():
        own = getattr(back.meshes[0], name)
        assert own is value if value is None else np.array_equal(own, value), name
    assert back.meshes[0].points.tobytes() == asked.meshes[0].points.tobytes()


def test_an_unknown_command_is_refused(tmp_path: Path) -> None:
    write_request(tmp_path, request("explode"))
    with pytest.raises(ValueError, match="expected check or repair, got 'explode'"):
        read_request(tmp_path)


def test_names_become_paths_of_their_own() -> None:
    asked = request("check")
    meshes = tuple(dataclasses.replace(asked.meshes[0], name=n) for n in ("a b", "a.b", "7"))
    paths = prim_paths(dataclasses.replace(asked, meshes=meshes))
    assert paths == ["/a_b", "/a_b_2", "/_7"] or len(set(paths)) == 3


def test_a_worker_repairs_and_leaves_clean_frames_bit_for_bit() -> None:
    asked = request("repair")
    worker = Worker(PYTHON, asked)
    try:
        told = worker.wait()
        (points,) = read_points(worker.folder / told["result"], asked.meshes)
    finally:
        worker.close()
    assert [frame["status"] for frame in told["frames"]] == ["clean", "clean"]
    assert told["frames"][1]["before"] > 0 == told["frames"][1]["after"]
    assert points[0].tobytes() == asked.meshes[0].points[0].tobytes()
    assert points[1].tobytes() != asked.meshes[0].points[1].tobytes()
    assert not worker.folder.exists()


def test_a_worker_lists_the_polygons_that_intersect() -> None:
    asked = request("check")
    worker = Worker(PYTHON, asked)
    try:
        told = worker.wait()
        first, second = read_pairs(worker.folder / told["result"], 2)
    finally:
        worker.close()
    half = len(asked.meshes[0].counts) // 2
    assert not len(first) and len(second) == told["frames"][1]["before"]
    assert (second[:, [0, 2]] == 0).all()
    assert ((second[:, 1] < half) != (second[:, 3] < half)).all()


def test_a_closed_worker_is_gone_with_its_folder() -> None:
    worker = Worker(PYTHON, request("repair"))
    assert worker.running and worker.poll() is None
    worker.close()
    assert not worker.running and not worker.folder.exists()


def test_what_goes_wrong_is_told() -> None:
    worker = Worker(PYTHON, request("explode"))
    try:
        with pytest.raises(WorkerError, match="got 'explode'"):
            worker.wait()
    finally:
        worker.close()
