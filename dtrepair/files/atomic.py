"""Files that appear whole or not at all.

A reader of the target path sees the old file or the complete new one, never a part: the bytes go to
a temporary file in the same directory, which replaces the target in one step.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def atomic_output(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it replaces `path` if the block ends without an error.

    The temporary name keeps the extension, because many writers choose their format by it.
    On any error the temporary file is removed and an existing `path` is left as it was.
    Raises OSError where the directory cannot be written.
    """
    target = Path(path)
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


def _permissions(target: Path) -> int:
    """Return the mode of the target file, or that of a new file of this user."""
    # mkstemp makes private files (0600); a result should look like any file the user creates.
    with suppress(FileNotFoundError):
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
