"""The one place where text goes out: control characters are shown, a full disk stops nothing."""

from __future__ import annotations

import errno
import os
import re
import sys
import traceback
from contextlib import suppress
from types import TracebackType

import click

# What moves a cursor, colours a terminal, turns writing round or is no character at all. Names in
# stages, paths and messages of libraries may hold any of it. Tabs and ends of lines are layout.
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
# The end of the text of a TypeError that pxr prints beside the error that it raises.
_BESIDE = "No to_python (by-value) converter found for C++ type"


def shown(text: str) -> str:
    """Return a text with control characters as escapes, such as \\x1b."""
    return _UNSEEN.sub(lambda found: ascii(found[0])[1:-1], text)


def shown_line(text: str) -> str:
    """Return a text as `shown` does, on one line: what a name holds starts no line of its own."""
    return shown(text).replace("\n", "\\n")


def say(text: str, *, err: bool = False, newline: bool = True) -> OSError | None:
    """Write a text to stdout or stderr; return why it could not be written, None if it was.

    A stream that failed once is written to no more: what is left in it would fail again at the end,
    and change the exit code.
    """
    stream = sys.stderr if err else sys.stdout
    if stream is None:
        return OSError(errno.EBADF, "it is closed")
    encoding = getattr(stream, "encoding", None) or "utf-8"
    plain = shown(text).encode(encoding, "backslashreplace").decode(encoding)
    try:
        click.echo(plain, err=err, nl=newline)
    except (OSError, ValueError) as error:  # ValueError: a closed file of Python
        with suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        return error if isinstance(error, OSError) else OSError(errno.EBADF, "it is closed")
    return None


def open_closed_streams() -> None:
    """Put the null device where stdin, stdout or stderr are closed.

    Else the next file that is opened, such as an output, would have the number of one of them, and
    get what libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            null = os.open(os.devnull, os.O_RDWR)
            if null != number:
                os.dup2(null, number)
                os.close(null)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")


def show_exception(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print an exception that nobody caught, as `sys.excepthook` does, with `shown` characters."""
    if not (isinstance(error, TypeError) and _BESIDE in str(error)):
        say("".join(traceback.format_exception(kind, error, trace)), err=True, newline=False)
