"""Files appear whole or not at all."""

import os
import stat
from pathlib import Path

import pytest

from dtrepair.files.atomic import atomic_output, write_atomically


def test_content_and_usual_permissions(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    plain = tmp_path / "plain.txt"
    plain.write_text("x")
    write_atomically(path, "text")
    assert path.read_bytes() == b"text"
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)


def test_an_error_keeps_the_old_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError, match="stop"), atomic_output(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError("stop")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_temporary_name_keeps_the_extension(tmp_path: Path) -> None:
    with atomic_output(tmp_path / "mesh.ply") as temporary:
        assert temporary.suffix == ".ply"
        assert temporary.parent == tmp_path


def test_existing_permissions_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(0o640)
    write_atomically(path, b"new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
