"""Files that appear whole or not at all.

A reader of the target path sees the old file or the complete new one, never a part: the bytes go to
a temporary file in the same directory, which replaces the target in one step. What is no file, such
as a FIFO, is never replaced.
"""

from __future__ import annotations

import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def atomic_output(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it replaces `path` if the block ends without an error.

    The temporary name keeps the extension, because many writers choose their format by it.
    On any error the temporary file is removed and an existing `path` is left as it was. A FIFO, a
    character device and an open file such as /dev/stdout get all bytes at the end of the block.
    Raises OSError where the directory cannot be written, or `path` is a directory, socket or disk.
    """
    target = Path(path)
    if _is_stream(target):
        with tempfile.TemporaryDirectory() as folder:
            content = Path(folder) / f"content{target.suffix}"
            content.touch()
            yield content
            _write_through(content, target)
        return
    handle, name = tempfile.mkstemp(
        prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent or Path(".")
    )
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        os.chmod(temporary, _permissions(target))
        os.replace(temporary, target)
    except BaseException:
        with suppress(FileNotFoundError):
            temporary.unlink()
        raise


def write_atomically(path: str | os.PathLike[str], content: bytes | str) -> None:
    """Write `content` (text as UTF-8) to `path`, whole or not at all. Raises OSError."""
    data = content.encode() if isinstance(content, str) else content
    with atomic_output(path) as temporary:
        temporary.write_bytes(data)


def _is_stream(target: Path) -> bool:
    """Return whether a target is written through. Raises OSError for what cannot be written."""
    try:
        mode = target.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        return False
    if stat.S_ISFIFO(mode) or stat.S_ISCHR(mode):
        return True
    if not stat.S_ISREG(mode):
        kind = "directory" if stat.S_ISDIR(mode) else "socket" if stat.S_ISSOCK(mode) else "disk"
        raise OSError(errno.EEXIST, f"it is a {kind}; name a file")
    return _is_open_file(os.fspath(target))


def _is_open_file(name: str) -> bool:
    """Return whether a path leads to an open file of a process, as /dev/stdout does."""
    while True:
        name = os.path.join(os.path.realpath(os.path.dirname(name)), os.path.basename(name))
        if name.startswith("/proc/"):
            return True
        if not os.path.islink(name):
            return False
        name = os.path.join(os.path.dirname(name), os.readlink(name))


def _write_through(content: Path, target: Path) -> None:
    # Not truncated: where /dev/stdout is a file, it has lines already.
    with (
        open(content, "rb") as source,
        os.fdopen(os.open(target, os.O_WRONLY | os.O_APPEND), "wb") as stream,
    ):
        shutil.copyfileobj(source, stream)


def _permissions(target: Path) -> int:
    """Return the mode of the target file, or that of a new file of this user."""
    # mkstemp makes private files (0600); a result should look like any file the user creates.
    with suppress(FileNotFoundError):
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
