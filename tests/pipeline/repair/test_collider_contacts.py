"""Contacts between colliders are told once, and change neither counts nor exit codes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dtrepair.pipeline import (
    ObjectOptions,
    ObjectSettings,
    PrimTable,
    Selection,
    check_stage,
    repair_keyposes,
    repair_stage,
)
from dtrepair.pipeline.errors import CLEAN, exit_code
from dtrepair.repair.options import RepairOptions
from tests.command_line import run
from tests.meshes import bent_tube, icosphere
from tests.pipeline.hosts import Listener
from usd_io import AuthoredMesh, write_animation

BOTH = "/Set/A/Mesh and /Set/B/Mesh"
STILL = ObjectOptions(collider="/Set//")


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """Three balls of a set, two of which meet from frame 3 on, and one that enters the third."""
    ball, faces = icosphere(1, radius=0.5)
    wheres = {
        "/Set/A": (0.0, 0.0, 0.0, 0.0),
        "/Set/B": (5.0, 5.0, 0.8, 0.9),
        "/Set/C": (2.5, 2.5, 2.5, 2.5),
        "/Free": (9.0, 3.3, 9.0, 9.0),
    }
    meshes = []
    for parent, places in wheres.items():
        moves = np.tile(np.eye(4), (4, 1, 1))
        moves[:, 3, 0] = places
        meshes.append(AuthoredMesh(f"{parent}/Mesh", faces, rest=ball, transforms=moves))
    path = tmp_path / "a.usda"
    write_animation(path, meshes, times=np.arange(1.0, 5.0))
    return path


def pairs_of(stage: Path, frame: str) -> int:
    (found,) = check_stage(stage, selection=Selection(frames=frame, prim="/Set//")).frames
    assert found.before is not None
    return found.before.pairs


def test_it_is_told_once_with_the_first_frame_that_has_it(stage: Path, tmp_path: Path) -> None:
    host = Listener()
    report = repair_stage(stage, tmp_path / "b.usda", objects=STILL, observer=host)
    (told,) = [text for text in host.warnings if "colliders" in text]
    assert (
        f"/Set/A/Mesh and /Set/B/Mesh ({pairs_of(stage, '3')} pairs in frame 3); as neither" in told
    )
    assert "/Set/C" not in told and told in report.warnings
    counts = [frame.before.pairs for frame in report.frames if frame.before is not None]
    assert counts[0] == counts[2] == counts[3] == 0 < counts[1]
    assert exit_code(report) == CLEAN


@pytest.mark.parametrize("how", ["ignored", "self", "free", "apart"])
def test_nothing_is_told_of_what_counts_or_was_left_out(
    stage: Path, tmp_path: Path, how: str
) -> None:
    ignore = ("/Set/A//,/Set/B//",) if how == "ignored" else ()
    host = Listener()
    repair_stage(
        stage,
        tmp_path / "b.usda",
        objects=ObjectOptions(collider="/Set/A//" if how == "free" else "/Set//", ignore=ignore),
        selection=Selection(frames="1:2") if how == "apart" else Selection(),
        options=RepairOptions(mode="self" if how == "self" else "both"),
        observer=host,
    )
    assert not [text for text in host.warnings if "colliders" in text]


def test_what_never_moves_by_its_mobility_is_counted_as_left(stage: Path, tmp_path: Path) -> None:
    """It is named as what nothing can be done about, so that no warning repeats it."""
    table = PrimTable("/Set//", ObjectSettings(mobility=0.0))
    host = Listener()
    report = repair_stage(stage, tmp_path / "b.usda", tables=(table,), observer=host)
    assert not [text for text in host.warnings if "colliders" in text]
    assert "nothing may move" in report.frames[2].message


def test_key_poses_tell_it_too(stage: Path, tmp_path: Path) -> None:
    host = Listener()
    report = repair_keyposes(stage, objects=STILL, observer=host)
    (told,) = [text for text in host.warnings if "colliders" in text]
    assert (
        "/Set/A/Mesh and /Set/B/Mesh (" in told
        and "in frame 3)" in told
        and told in report.warnings
    )


# Of the cluster's own event loops, at their end.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
def test_several_workers_tell_it_as_one_run_does(stage: Path, tmp_path: Path) -> None:
    arguments = ("repair", stage, "--collider", "/Set//", "--alone", "-o")
    one = run(*arguments, tmp_path / "b.usda")
    several = run(*arguments, tmp_path / "c.usda", "--distributed", "local", "--jobs", "2")
    told = [[t for t in done.err.splitlines() if "colliders" in t] for done in (one, several)]
    assert told[0] == told[1] and len(told[0]) == 1 and one.code == several.code == 0


@pytest.mark.parametrize(
    ("objects", "mode", "told"),
    [
        (ObjectOptions(collider="/Set/Tube"), "both", True),
        (ObjectOptions(rigid="/Set/Tube"), "both", True),
        (ObjectOptions(rigid="/Set/Tube"), "inter", False),
        (ObjectOptions(rigid="/Set/Tube", ignore=("/Set/Tube,/Set/Tube",)), "both", False),
        (ObjectOptions(), "both", False),
    ],
)
def test_what_keeps_its_shape_and_intersects_itself_in_frames_is_told(
    tmp_path: Path, objects: ObjectOptions, mode: str, told: bool
) -> None:
    """Its rest does not, so that nothing else tells it."""
    poses = [bent_tube(angle)[0] for angle in (1.0, 2.0, 7.0)]
    ball, faces = icosphere(1)
    meshes = [
        AuthoredMesh("/Set/Tube", bent_tube(1.0)[1], rest=poses[0], points=poses),
        AuthoredMesh("/Set/Ball", faces, points=[ball + 9.0] * 3),
    ]
    write_animation(tmp_path / "a.usda", meshes, times=np.arange(1.0, 4.0))
    options, count = RepairOptions(mode=mode), pairs_of(tmp_path / "a.usda", "3")
    report = repair_stage(
        tmp_path / "a.usda", tmp_path / "b.usda", objects=objects, options=options
    )
    found = [text for text in report.warnings if "intersect themselves" in text]
    assert count > 0 and exit_code(report) == CLEAN and len(found) == told
    assert all(f"/Set/Tube ({count} pairs in frame 3); as the" in text for text in found)
