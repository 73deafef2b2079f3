"""The exceptions of this package: one line each, saying what, where and the cure.

Every class carries the exit code a command line should end with.
"""

from __future__ import annotations

import math
import re


class UsdIoError(Exception):
    """Base of every error raised on purpose by this package."""

    exit_code = 3


class StageError(UsdIoError):
    """The input stage or one of its meshes cannot be used."""

    exit_code = 3


class UsageError(UsdIoError):
    """The caller asked for something that makes no sense; nothing was touched."""

    exit_code = 2


class FrameSpecError(UsageError):
    """A frame specification cannot be parsed or selects nothing."""


class SelectionError(UsageError):
    """A prim expression cannot be parsed or matches no usable mesh."""


class FrameError(UsdIoError):
    """One frame of one mesh cannot be used; the other frames may be fine.

    Attributes:
        path: prim path of the mesh.
        time: time code of the frame (NaN for the default time).
    """

    exit_code = 4

    def __init__(self, path: str, time: float, reason: str) -> None:
        """Name the mesh and the frame in front of the reason."""
        self.path = path
        self.time = time
        super().__init__(f"{path} at {time_text(time)}: {reason}")


class OutputError(UsdIoError):
    """The output cannot be written; an older file of that name is intact."""

    exit_code = 5


def time_text(time: float) -> str:
    """Return words for a time code in a message: 'the default time' for NaN, or 'frame 12.5'."""
    return "the default time" if math.isnan(time) else f"frame {time:.15g}"


def one_line(error: BaseException, limit: int = 300) -> str:
    """Return the message of an exception of pxr as one line, without its source locations."""
    try:
        text = str(error)
    except UnicodeError:  # the text of pxr may hold a part of a character
        text = ""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    lines = [line for line in lines if not line.startswith(("->", "#", "..."))] or lines
    messages = [line.split(" : ", 1)[-1] for line in lines]
    messages = [text[1:-1] if text[:1] == text[-1:] == "'" else text for text in messages]
    text = "; ".join(dict.fromkeys(message for message in messages if message))
    # Namespaces and C++ names of the build say nothing to a user.
    text = re.sub(r"pxrInternal\w*?__pxrReserved__::", "", text) or type(error).__name__
    return text if len(text) <= limit else text[: limit - 3] + "..."
