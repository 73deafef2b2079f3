"""What is inside and what is out: mirrored objects, and objects within others."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dtrepair.report.record import read_report
from tests.command_line import run
from tests.meshes import icosphere

BALL, BALL_FACES = icosphere(2, radius=0.5)


def test_a_mirrored_object_is_pushed_out_not_in(tmp_path: Path) -> None:
    from pxr import Usd

    from usd_io import AuthoredMesh, write_animation

    flip = np.diag([-1.0, 1.0, 2.0, 1.0])
    flip[3, :3] = (0.6, 0.1, 0.0)
    meshes = [
        AuthoredMesh(path="/A", faces=BALL_FACES, rest=BALL),
        AuthoredMesh(path="/Mirror/B", faces=BALL_FACES, rest=BALL, transforms=flip[None]),
    ]
    path, out = tmp_path / "a.usda", tmp_path / "b.usda"
    write_animation(path, meshes, times=(1.0,))
    assert run("repair", path, "-o", out, "--rigid", "/A", "--collider", "/Mirror/B").code == 0
    stage = Usd.Stage.Open(str(out))
    moved = np.array(stage.GetPrimAtPath("/A").GetAttribute("points").Get(1)) - BALL
    # Away from B, and not farther than to where the two touch.
    assert moved[:, 0].mean() < 0 and np.linalg.norm(moved, axis=1).max() < 0.6


def test_what_lies_wholly_inside_is_told(tmp_path: Path) -> None:
    from usd_io import AuthoredMesh, write_animation

    into = np.tile(np.eye(4), (3, 1, 1))
    into[:, 3, :3] = [(3.0, 0, 0), (0.1, 0.05, 0), (3.0, 0, 0)]
    meshes = [
        AuthoredMesh(path="/Head/Mesh", faces=BALL_FACES, rest=BALL),
        AuthoredMesh(path="/Pea/Mesh", faces=BALL_FACES, rest=0.2 * BALL, transforms=into),
    ]
    path, out, report = tmp_path / "a.usda", tmp_path / "b.usda", tmp_path / "r.json"
    write_animation(path, meshes, times=(1.0, 2.0, 3.0))
    table = tmp_path / "settings.toml"
    table.write_text('[[prim]]\npath = "/Pea"\nmobility = 0\n')
    held = ("--config", table)
    done = run("repair", path, "-o", out, "--report", report, *held)
    assert done.code == 1
    frames = read_report(report)["frames"]
    assert [frame["status"] for frame in frames] == ["clean", "unchanged", "clean"]
    assert "/Pea/Mesh lies wholly inside /Head/Mesh" in frames[1]["message"]
    free = run("repair", path, "-o", out, "--report", report, "--alone")
    frames = read_report(report)["frames"]
    assert free.code == 0 and [frame["status"] for frame in frames] == ["clean"] * 3
    assert frames[1]["displacement_max"] > 0.3
