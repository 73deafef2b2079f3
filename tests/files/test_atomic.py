"""Files appear whole or not at all."""

import os
import socket
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


def test_a_fifo_is_written_through(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_atomically(path, "text")
        assert os.read(reader, 100) == b"text"
    finally:
        os.close(reader)
    assert path.is_fifo() and os.listdir(tmp_path) == ["a.txt"]


def test_a_terminal_is_written_through(tmp_path: Path) -> None:
    reader, terminal = os.openpty()
    link = tmp_path / "link"
    link.symlink_to(os.ttyname(terminal))
    try:
        for path in (os.ttyname(terminal), link):
            write_atomically(path, "text")
            assert os.read(reader, 100) == b"text"
            assert Path(path).is_char_device()
    finally:
        os.close(reader)
        os.close(terminal)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="open files have no names here")
def test_an_open_file_gets_the_bytes_after_its_own(tmp_path: Path) -> None:
    # As /dev/stdout where it is redirected to a file.
    path, link = tmp_path / "a.txt", tmp_path / "link"
    with open(path, "wb", buffering=0) as file:
        link.symlink_to(f"/proc/self/fd/{file.fileno()}")
        file.write(b"before, ")
        write_atomically(link, "text")
    assert path.read_text() == "before, text"
    assert link.is_symlink() and sorted(os.listdir(tmp_path)) == ["a.txt", "link"]


def test_sockets_and_directories_are_refused(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as own:
        own.bind(str(tmp_path / "socket"))
        (tmp_path / "directory").mkdir()
        for name in ("socket", "directory"):
            with pytest.raises(OSError, match=f"it is a {name}; name a file"):
                write_atomically(tmp_path / name, "text")
        assert (tmp_path / "socket").is_socket()
    assert sorted(os.listdir(tmp_path)) == ["directory", "socket"]
