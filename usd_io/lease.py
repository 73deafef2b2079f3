"""Files that nobody may cut short for a moment: while USD has them mapped into memory."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

try:
    import fcntl
except ImportError:  # a system without leases
    fcntl = None  # type: ignore[assignment]


@contextmanager
def uncut(path: str) -> Iterator[None]:
    """Let whoever opens a file for writing, or cuts it, wait until the end of the block.

    A lease of Linux: the other waits for at most `/proc/sys/fs/lease-break-time`, 45 s. Without
    effect where there are none: on other systems and network disks, for files of other users, and
    for files that somebody has open for writing.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        yield
        return
    try:
        with suppress(AttributeError, OSError):
            # The signal that tells of the other would end the process; this one is ignored.
            fcntl.fcntl(handle, fcntl.F_SETSIG, signal.SIGURG)
            fcntl.fcntl(handle, fcntl.F_SETLEASE, fcntl.F_RDLCK)
        yield
    finally:
        os.close(handle)
