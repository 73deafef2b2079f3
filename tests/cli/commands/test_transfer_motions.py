"""`dtrepair transfer`: which poses are taken over, and from where."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.command_line import (
    read_samples,
    run,
    tube_obj,
    tube_polygons,
    tube_pose,
    tube_stage,
    write_obj,
)
from usd_io import AuthoredMesh, write_animation


def test_a_rest_file_with_an_animated_stage(tmp_path: Path) -> None:
    output = tmp_path / "c.usdc"
    source = tube_stage(tmp_path / "anim.usda", (1.0, 2.0), rest=None)
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    done = run("transfer", rest, rest, "--poses", source, "-o", output)
    assert done.code == 0 and done.err == ""
    found, expected = read_samples(output, "/rest/Mesh"), read_samples(source)
    assert np.abs(found[2.0] - expected[2.0]).max() < 1e-5
    guessed = run("transfer", source, rest, "-o", output)
    assert "its rest pose is taken from frame 1" in guessed.err


def test_poses_in_other_units_are_told(tmp_path: Path) -> None:
    rest = tube_obj(tmp_path / "rest.obj", 0.0)
    large = write_obj(tmp_path / "large.obj", 100 * tube_pose(1.0), tube_polygons())
    done = run("transfer", rest, rest, "--poses", large, "-o", tmp_path / "o.usda")
    assert "in other units" in done.err


def test_motion_of_the_sources_transform_is_taken_along(tmp_path: Path) -> None:
    matrices = np.tile(np.eye(4), (3, 1, 1))
    matrices[:, 3, 0] = (5.0, 6.0, 8.0)
    poses_of = [tube_pose(0.5)] * 3
    mesh = AuthoredMesh(
        "/A/Tube", tube_polygons(), poses_of, rest=tube_pose(0.0), transforms=matrices
    )
    write_animation(tmp_path / "a.usda", mesh, times=(1, 2, 3))
    target = tube_obj(tmp_path / "b.obj", 0.0)
    run("transfer", tmp_path / "a.usda", target, "-o", tmp_path / "c.usda", "--root-scale", 1)
    found = np.stack(list(read_samples(tmp_path / "c.usda", "/b/Mesh").values()))
    travel = (found - found[0]).mean(axis=1)
    assert np.abs(travel - np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0]])).max() < 1e-4
