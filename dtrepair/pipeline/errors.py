"""The errors of a run, and the exit codes that a process should end with for each of them."""

from __future__ import annotations

CLEAN, REMAINING, USAGE, INPUT, FRAMES, OUTPUT = range(6)
INTERNAL = 70  # a defect of the program itself (EX_SOFTWARE)
CANCELLED = 130  # as a shell reports a process that Ctrl-C ended


class PipelineError(Exception):
    """A run that ended without a result; the message says in one line what, where and the cure.

    Attributes:
        exit_code: what a process should end with; each subclass has a code of its own.
    """

    exit_code = INTERNAL

    def __init__(self, message: str, exit_code: int | None = None) -> None:
        """Keep the message, and a code where it is not that of the class."""
        super().__init__(message)
        if exit_code is not None:
            self.exit_code = exit_code


class UsageError(PipelineError):
    """The caller asked for something that makes no sense; nothing was touched."""

    exit_code = USAGE


class InputError(PipelineError):
    """The input cannot be used."""

    exit_code = INPUT


class OutputError(PipelineError):
    """An output cannot be written; an older file of that name is intact."""

    exit_code = OUTPUT


class Cancelled(PipelineError):
    """The observer asked for the end; an older output is intact, and the journal is kept."""

    exit_code = CANCELLED
