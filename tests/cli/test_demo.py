"""`dtrepair demo`: the first command of the README."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from dtrepair.report.record import read_report
from tests.command_line import Outcome, assert_fails, read_samples, run

FILES = ["before_after.png", "demo.usda", "demo_repaired.usdc", "report.json"]


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """A short clip: its middle frame is the deepest."""
    folder = tmp_path_factory.mktemp("demo") / "new"
    return folder, run("demo", folder, "--frames", 5)


def test_files_and_table(demo: tuple[Path, Outcome]) -> None:
    folder, done = demo
    assert done.code == 0 and done.err == ""
    assert sorted(path.name for path in folder.iterdir()) == FILES
    assert "4384 quads, 5 frames" in done.out
    assert "5 of 5 frames clean" in done.out


def test_before_intersects_and_after_does_not(demo: tuple[Path, Outcome]) -> None:
    folder, _ = demo
    before = run("check", folder / "demo.usda", "--json", "-").json
    assert run("check", folder / "demo_repaired.usdc").code == 0
    assert before["summary"]["clean"] == 4 and before["summary"]["triangles_before"] > 100
    report = read_report(folder / "report.json")
    assert report["prims"][0]["rest_intersections"] == 0
    assert report["summary"]["triangles_before"] == before["summary"]["triangles_before"]


def test_frames_move_little(demo: tuple[Path, Outcome]) -> None:
    folder, _ = demo
    before = read_samples(folder / "demo.usda", "/Character/Body")
    after = read_samples(folder / "demo_repaired.usdc", "/Character/Body")
    assert list(after) == list(before) == [1, 2, 3, 4, 5]
    for time in before:
        assert abs(before[time] - after[time]).max() < 0.2  # metres, of a figure of 1.9


def test_the_parent_moves(demo: tuple[Path, Outcome]) -> None:
    from pxr import Usd, UsdGeom

    folder, _ = demo
    stage = Usd.Stage.Open(str(folder / "demo_repaired.usdc"))
    character = UsdGeom.Xformable(stage.GetPrimAtPath("/Character"))
    assert len(character.GetTimeSamples()) == 5
    matrices = [character.ComputeLocalToWorldTransform(time) for time in (1, 5)]
    assert matrices[0] != matrices[1]


def test_without_pillow_the_rest_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "PIL", None)
    done = run("demo", tmp_path, "--frames", 3)
    assert done.code == 0
    assert "not drawn" in done.err and "pip install pillow" in done.err
    assert not (tmp_path / "before_after.png").exists()


def test_a_device_that_is_not_there_leaves_nothing(tmp_path: Path) -> None:
    assert_fails(run("demo", tmp_path / "new", "--frames", 3, "--device", "cuda:64"), 2, "--device")
    assert not (tmp_path / "new").exists()


def test_directory_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert_fails(run("demo", tmp_path / "file" / "below"), 5, "cannot be made")
