"""Temporary folders of outputs: named after their process, removed when it is gone."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from usd_io.write.temporary import make_temporary_folder, remove_own_folders, remove_stale_folders


@pytest.fixture
def ended() -> int:
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def folder_of(
    directory: Path, process: int | str, *, host: str | None = None, output: str = "b.usdc"
) -> Path:
    folder = directory / f".{output}.{host or socket.gethostname()}-{process}.abc.tmp"
    folder.mkdir()
    (folder / "b.usdc").write_text("part")
    return folder


def test_folders_of_killed_runs_are_removed(tmp_path: Path, ended: int) -> None:
    stale = folder_of(tmp_path, ended)
    kept = [
        folder_of(tmp_path, os.getpid()),
        folder_of(tmp_path, os.getppid()),
        folder_of(tmp_path, ended, host="another"),
        folder_of(tmp_path, ended, output="other.usdc"),
        folder_of(tmp_path, "x"),
    ]
    made = make_temporary_folder(str(tmp_path / "b.usdc"))
    assert os.path.isdir(made) and os.path.dirname(made) == str(tmp_path)
    assert not stale.exists() and all(folder.exists() for folder in kept)


def test_own_folders_are_removed_on_demand(tmp_path: Path) -> None:
    path = tmp_path / "b.usdc"
    made = make_temporary_folder(str(path))
    other = make_temporary_folder(str(tmp_path / "c.usdc"))
    remove_own_folders(path)
    assert not os.path.exists(made) and os.path.exists(other)
    remove_stale_folders(str(tmp_path / "none" / "b.usdc"))  # nothing there, nothing happens


def test_missing_directories_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(OSError):
        make_temporary_folder(str(tmp_path / "none" / "b.usdc"))
