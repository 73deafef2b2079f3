"""The folder of an interrupted run: private, authentic, and nothing of others is touched."""

from __future__ import annotations

import json
import os
import shutil
import stat
from pathlib import Path

import numpy as np
import pytest

from dtrepair.pipeline.repair.journal import Journal

KEYS = ["0" * 32, "1" * 32]
ARRAYS = {"points": np.arange(6.0).reshape(2, 3)}


@pytest.fixture
def output(tmp_path: Path) -> str:
    return str(tmp_path / "b.usdc")


def kept(output: str, run: str = "first") -> Path:
    """The folder of an interrupted run with two entries."""
    journal = Journal(output, run, resume=False)
    for number, key in enumerate(KEYS):
        journal.keep(key, {"points": ARRAYS["points"] + number})
    assert journal.failures == journal.warnings == [] and journal.kept == 2
    return journal.folder


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_entries_come_back(output: str) -> None:
    kept(output)
    journal = Journal(output, "first", resume=True)
    for number, key in enumerate(KEYS):
        found = journal.recall(key)
        assert found is not None
        assert np.array_equal(found["points"], ARRAYS["points"] + number)
    assert journal.recall("2" * 32) is None and journal.recalled == 2
    journal.remove()
    assert os.listdir(os.path.dirname(output)) == []


@pytest.mark.skipif(os.name != "posix", reason="no permissions here")
def test_the_folder_is_of_its_user_alone(output: str) -> None:
    mask = os.umask(0)
    try:
        folder = kept(output)
    finally:
        os.umask(mask)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    folder.chmod(0o777)  # as of somebody who waits for a run
    journal = Journal(output, "first", resume=True)
    assert journal.recall(KEYS[0]) is None and "no repair of this user" in journal.warnings[0]


def test_nothing_goes_through_a_link(tmp_path: Path, output: str) -> None:
    folder = kept(output)
    elsewhere = tmp_path / "elsewhere"
    for run in ("first", "second"):
        shutil.rmtree(elsewhere, ignore_errors=True)
        if not folder.is_symlink():
            folder.rename(elsewhere)
            folder.symlink_to(elsewhere)
        else:
            elsewhere.mkdir(mode=0o700)
        before = content(elsewhere)
        journal = Journal(output, run, resume=True)
        assert journal.recall(KEYS[0]) is None
        journal.keep("2" * 32, ARRAYS)
        journal.remove()
        assert content(elsewhere) == before and folder.is_symlink() and journal.kept == 0
        assert len(journal.warnings) == 1 and "move it away" in journal.warnings[0]


def test_a_link_that_comes_later_is_not_followed(tmp_path: Path, output: str) -> None:
    journal = Journal(output, "first", resume=False)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    journal.folder.symlink_to(elsewhere)
    journal.keep(KEYS[0], ARRAYS)
    assert len(journal.failures) == 1 and os.listdir(elsewhere) == []
    assert sorted(os.listdir(tmp_path)) == [".b.usdc.resume", "elsewhere"]


@pytest.mark.parametrize("header", [None, "not JSON", json.dumps({"run": 3}), json.dumps([])])
def test_a_folder_of_others_is_left_alone(output: str, header: str | None) -> None:
    folder = Path(f"{os.path.dirname(output)}/.b.usdc.resume")
    folder.mkdir(mode=0o700)
    (folder / "thesis.txt").write_text("years of work")
    (folder / f"{KEYS[0]}.npz").write_bytes(b"mine")
    if header is not None:
        (folder / "run.json").write_text(header)
    before = content(folder)
    for resume in (True, False):
        journal = Journal(output, "first", resume=resume)
        journal.keep(KEYS[0], ARRAYS)
        journal.remove()
        assert content(folder) == before and "progress cannot be kept" in journal.warnings[0]


def test_what_no_repair_made_outlives_the_run(output: str) -> None:
    folder = kept(output)
    (folder / "thesis.txt").write_text("years of work")
    (folder / f".{KEYS[0]}-ab12.npz").write_text("what a killed run was writing")
    Journal(output, "second", resume=True)  # starts over
    assert os.listdir(folder) == ["thesis.txt"]


def test_only_entries_as_they_were_made_count(output: str) -> None:
    folder = kept(output)
    first, second = (folder / f"{key}.npz" for key in KEYS)
    entry = first.read_bytes()
    journal = Journal(output, "first", resume=True)
    for place in (0, len(entry) // 2, len(entry) - 1):
        damaged = bytearray(entry)
        damaged[place] ^= 1
        first.write_bytes(damaged)
        assert journal.recall(KEYS[0]) is None
    for length in (0, 10, len(entry) - 1):
        first.write_bytes(entry[:length])
        assert journal.recall(KEYS[0]) is None
    np.savez(first, points=ARRAYS["points"])  # whole, and of somebody else
    assert journal.recall(KEYS[0]) is None
    second.write_bytes(entry)  # of another window
    assert journal.recall(KEYS[1]) is None
    first.write_bytes(entry)
    assert journal.recall(KEYS[0]) is not None and journal.recalled == 1


def test_entries_of_another_run_do_not_count(output: str) -> None:
    folder = kept(output, "first")
    (folder / "run.json").write_text(json.dumps({"run": "second"}))
    assert Journal(output, "second", resume=True).recall(KEYS[0]) is None
