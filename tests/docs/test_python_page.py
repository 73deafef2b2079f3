"""The part of docs/python.md on options runs, and what it says holds."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.repair.options import OptionError
from tests.command_line import CLOSED, OPEN, tube_polygons, tube_pose
from tests.meshes import split_quads
from usd_io import AuthoredMesh, write_animation

PAGE = (Path(__file__).parents[2] / "docs" / "python.md").read_text(encoding="utf-8")
SECTION = PAGE.split("## Options\n")[1].split("\n## ")[0]
ARRAYS, STAGE = re.findall(r"```python\n(.*?)```", SECTION, re.DOTALL)


def test_options_of_arrays() -> None:
    rest, faces = tube_pose(OPEN), split_quads(tube_polygons())
    names: dict[str, Any] = {
        "points": tube_pose(CLOSED),
        "rest": rest,
        "faces": faces,
        "pin": np.zeros(len(rest)),
        "bodies": [Body(rest, faces)],
    }
    exec(ARRAYS, names)
    assert names["result"].after.pairs == 0 < names["result"].before.pairs
    assert names["scene"].options.clearance == names["options"].clearance > 0.0


def hero(path: Path, *, shift: float = 3.0) -> None:
    """A body that closes on itself, a sword and a set, far from one another."""
    angles = {"/Hero/Body": CLOSED, "/Hero/Sword": OPEN, "/Set/Wall": OPEN}
    meshes = [
        AuthoredMesh(
            name,
            tube_polygons(),
            points=[tube_pose(own) + np.array([shift * row, 0.0, 0.0]) for own in (OPEN, angle)],
            rest=tube_pose(OPEN) + np.array([shift * row, 0.0, 0.0]),
        )
        for row, (name, angle) in enumerate(angles.items())
    ]
    write_animation(path, meshes, times=[1.0, 2.0])


def test_options_of_a_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("shot.usd", "hero_rest.usd"):
        hero(tmp_path / name)
    names: dict[str, Any] = {}
    exec(STAGE, names)
    settings = names["report"].settings
    assert (settings["clearance"], settings["effort"]) == (0.01, 2.0)
    assert settings["rest"] == ["hero_rest.usd"] * 3 and settings["collider"] == "/Set//"
    assert [frame.status for frame in names["report"].frames] == ["clean", "clean"]


def test_a_value_out_of_range_names_its_field() -> None:
    with pytest.raises(OptionError, match="clearance"):
        RepairOptions(clearance=-1.0)
