"""Temporary folders beside an output, and those that killed runs left there."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile

SUFFIX = ".tmp"


def make_temporary_folder(path: str) -> str:
    """Make a hidden folder beside an output path and return it.

    Those of runs that no longer exist are removed.

    The name tells host and process: a killed run cannot remove its folder, the next one does.
    Raises OSError where the directory cannot be written to.
    """
    remove_stale_folders(path)
    return tempfile.mkdtemp(
        prefix=f"{_prefix(path)}{os.getpid()}.", suffix=SUFFIX, dir=os.path.dirname(path)
    )


def remove_stale_folders(path: str) -> None:
    """Remove the temporary folders of an output path whose process on this host has ended."""
    for folder, process in _folders(path):
        if not _is_running(process):
            shutil.rmtree(folder, ignore_errors=True)


def remove_own_folders(path: str | os.PathLike[str]) -> None:
    """Remove the temporary folders of an output path that this process made: it will exit now."""
    for folder, process in _folders(os.path.abspath(os.fspath(path))):
        if process == os.getpid():
            shutil.rmtree(folder, ignore_errors=True)


def _prefix(path: str) -> str:
    """Return how the names of temporary folders of an output on this host begin."""
    return f".{os.path.basename(path)}.{socket.gethostname()}-"


def _folders(path: str) -> list[tuple[str, int]]:
    """Return the temporary folders of an output made on this host, and their processes."""
    directory, prefix = os.path.dirname(path), _prefix(path)
    try:
        names = os.listdir(directory)
    except OSError:
        return []
    folders = []
    for name in names:
        process = name.removeprefix(prefix).partition(".")[0]
        if name.startswith(prefix) and name.endswith(SUFFIX) and process.isdecimal():
            folders.append((os.path.join(directory, name), int(process)))
    return folders


def _is_running(process: int) -> bool:
    """Return whether a process of this number exists."""
    if os.name != "posix":
        return True  # there, signal 0 is not a question
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
