"""What is taken as worn is told once for a run, where anything is repaired, as no warning."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair.pipeline import (
    ObjectOptions,
    Selection,
    WornFound,
    repair_keyposes,
    repair_stage,
)
from dtrepair.repair.options import RepairOptions
from tests.command_line import run
from tests.meshes import joined, tube
from tests.pipeline.hosts import Listener
from usd_io import AuthoredMesh, write_animation

ARM, SLEEVE = tube(24, 40, 0.2, 4.0), tube(24, 12, 0.23, 1.0)
GROWTH = (0.0, 0.0, 0.3, 0.4, 0.4)

BELL = np.exp(-((ARM[0][:, 2:] / 0.4) ** 2)) * (1.0, 1.0, 0.0)


@pytest.fixture
def sleeve(tmp_path: Path) -> Path:
    """An arm that swells through its sleeve from frame 3 on."""
    path = tmp_path / "sleeve.usda"
    poses = [ARM[0] * (1.0 + growth * BELL) for growth in GROWTH]
    meshes = [
        AuthoredMesh("/Hero/Arm", ARM[1], points=poses, rest=ARM[0]),
        AuthoredMesh("/Hero/Sleeve", SLEEVE[1], rest=SLEEVE[0]),
    ]
    write_animation(path, meshes, times=np.arange(1.0, 6.0))
    return path


def worn(host: Listener) -> list[tuple[str, str]]:
    """What was told, which must be once at most, by the names of the parts."""
    told = [remark.worn for remark in host.remarks if isinstance(remark, WornFound)]
    assert len(told) < 2
    return [(over.name, under.name) for each in told for over, under in each]


@pytest.mark.parametrize("alone", [False, True])
def test_it_is_told_once_which_part_lies_over_which(
    sleeve: Path, tmp_path: Path, alone: bool
) -> None:
    host = Listener()
    repair_stage(sleeve, tmp_path / "b.usda", alone=alone, observer=host)
    assert worn(host) == [("/Hero/Sleeve", "/Hero/Arm")] and host.warnings == []


@pytest.mark.parametrize("how", ["frames", "layer", "ignore", "paper"])
def test_nothing_is_told_of_what_is_clean_told_or_not_known(
    sleeve: Path, tmp_path: Path, how: str
) -> None:
    host = Listener()
    repair_stage(
        sleeve,
        tmp_path / "b.usda",
        selection=Selection(frames="1:2" if how == "frames" else "3"),
        objects=ObjectOptions(
            layer=("/Hero/Sleeve=1",) if how == "layer" else (),
            ignore=("/Hero/Sleeve,/Hero/Arm",) if how == "ignore" else (),
        ),
        options=RepairOptions(method="paper", iterations=1) if how == "paper" else RepairOptions(),
        observer=host,
    )
    assert worn(host) == []


def test_key_poses_tell_it_where_they_are_repaired(sleeve: Path, tmp_path: Path) -> None:
    heard, silent = Listener(), Listener()
    repair_keyposes(sleeve, tmp_path / "b.usda", observer=heard)
    repair_keyposes(sleeve, observer=silent)
    assert worn(heard) == [("/Hero/Sleeve", "/Hero/Arm")] and worn(silent) == []


def test_the_command_says_it_and_what_changes_it(sleeve: Path, tmp_path: Path) -> None:
    arguments = ("repair", sleeve, "--frames", "3", "-o", tmp_path / "b.usda")
    (line,) = run(*arguments).err.splitlines()
    told = "taken as worn: /Hero/Sleeve over /Hero/Arm; another order with --layer"
    assert line == f"dtrepair: {told}"
    assert run(*arguments, "-q").err == ""


def test_two_warnings_do_not_name_the_same_cure(tmp_path: Path) -> None:
    """Parts of one mesh that meet in all of two frames, without a bind pose."""
    path, (points, faces) = tmp_path / "a.usda", joined(ARM, SLEEVE)
    points[: len(ARM[0])] *= 1.0 + 0.3 * BELL
    mesh = AuthoredMesh("/Hero/Dressed", faces, points=[points, points])
    write_animation(path, mesh, times=[1.0, 2.0])
    rest, parts = run("repair", path, "-o", tmp_path / "b.usda").err.splitlines()[:2]
    assert "rest poses that intersect themselves: /Hero/Dressed (" in rest
    assert "with --rest" not in rest and "with --rest" in parts
