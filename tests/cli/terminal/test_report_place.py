"""`--report -`: the report alone on stdout, for every command that has it."""

from __future__ import annotations

import json
import os
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


def test_what_is_no_file_stays_what_it_is(tmp_path: Path) -> None:
    path, layer, report = (tmp_path / name for name in ("a.usda", "b.usdc", "r.json"))
    tube_stage(path, (OPEN, CLOSED))
    os.mkfifo(layer)
    os.mkfifo(report)
    assert_fails(run("repair", path, "-o", layer), 5, "b.usdc", "FIFO")
    reader = os.open(report, os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert run("check", path, "--json", report).code == 1
        validate(json.loads(os.read(reader, 1 << 16)))
    finally:
        os.close(reader)
    assert layer.is_fifo() and report.is_fifo()
    assert sorted(os.listdir(tmp_path)) == ["a.usda", "b.usdc", "r.json"]


def test_a_full_device_is_told(tmp_path: Path) -> None:
    path, output = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED)), tmp_path / "b.usdc"
    full = tmp_path / "full"
    full.symlink_to("/dev/full")
    done = run("repair", path, "-o", output, "--report", full)
    assert done.code == 5 and "full: cannot be written: No space left" in done.err
    assert output.exists() and full.is_char_device()
