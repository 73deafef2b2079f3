"""`--report -`: the report alone on stdout, for every command that has it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dtrepair.report.schema import validate
from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_stage


@pytest.mark.parametrize("command", ["repair", "keyposes"])
def test_stdout_holds_the_report_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    output = tmp_path / "b.usdc"
    done = run(command, path, "-o", output, "--report", "-")
    assert done.code == 0, done
    validate(done.json)
    assert done.json["command"] == command
    assert f"written: {output}" in done.err and "2 of 2 frames clean" in done.err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.usda", "b.usdc"]
    skipped = run(command, path, "-o", output, "--report", "-", "--skip-existing")
    assert skipped.code == 0 and skipped.out == "" and "skipped" in skipped.err
    quiet = run(command, path, "-o", output, "--report", "-", "-q")
    assert quiet.err == "" and quiet.json["command"] == command


def test_a_transfer_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = tube_stage(tmp_path / "a.usda", (OPEN, OPEN))
    done = run("transfer", path, path, "-o", tmp_path / "b.usdc", "--report", "-")
    assert done.code == 0, done
    assert done.json["command"] == "transfer" and "written: " in done.err
    assert not (tmp_path / "-").exists()


def test_other_places_are_checked_first(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    output = ("-o", tmp_path / "b.usdc", "--report")
    assert_fails(run("repair", path, *output, tmp_path), 5, "is a directory")
    assert_fails(run("repair", path, *output, path), 2, "is an input")
    assert not (tmp_path / "b.usdc").exists()
