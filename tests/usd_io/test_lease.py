"""Files that are not cut while USD has them mapped into memory."""

from __future__ import annotations

import fcntl
import os
import sys
import tempfile
import threading
from pathlib import Path

import pytest
from pxr import Sdf, UsdUtils

from tests.usd_stages import cube_file
from usd_io import StageError, open_stage, read_meshes
from usd_io.lease import uncut


def leased() -> bool:
    """Whether files of temporary folders can be leased here: not on network disks."""
    if sys.platform != "linux":
        return False
    with tempfile.TemporaryFile() as file:
        try:
            fcntl.fcntl(file, fcntl.F_SETLEASE, fcntl.F_UNLCK)
        except OSError:
            return False
    return True


pytestmark = pytest.mark.skipif(not leased(), reason="files cannot be leased here")


def test_who_cuts_a_file_waits_for_its_lease(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(bytes(100))
    cutter = threading.Thread(target=os.truncate, args=(file, 3))
    with uncut(str(file)):
        cutter.start()
        cutter.join(0.2)
        assert cutter.is_alive() and file.stat().st_size == 100
    cutter.join(60)
    assert file.stat().st_size == 3


def test_files_that_cannot_be_leased_are_read_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "file"
    with uncut(str(file)):  # not there
        pass
    with open(file, "wb"), uncut(str(file)):  # somebody writes it
        os.truncate(file, 3)
    assert file.stat().st_size == 3


def test_a_package_that_somebody_cuts_is_opened_whole_and_told_afterwards(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Text inside a package can only be parsed from the mapped file."""
    package = tmp_path / "shot.usdz"
    shot = cube_file(tmp_path / "shot.usda", times=range(5))
    assert UsdUtils.CreateNewUsdzPackage(str(shot), str(package))
    cutter = threading.Thread(target=os.truncate, args=(package, 100))
    opened = Sdf.Layer.FindOrOpen

    def cut_and_open(identifier: str) -> Sdf.Layer:
        cutter.start()
        cutter.join(0.2)
        return opened(identifier)

    monkeypatch.setattr(Sdf.Layer, "FindOrOpen", cut_and_open)
    stage = open_stage(package)
    cutter.join(60)
    assert len(read_meshes(stage).meshes[0].times) == 5
    with pytest.raises(StageError, match=r"shot\.usdz: was changed while it was read, from"):
        stage.check_unchanged()
