"""The errors of a run, and the exit codes that a process should end with for each of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # a command's help needs the codes and no report
    from dtrepair.report.record import Report

CLEAN, REMAINING, USAGE, INPUT, FRAMES, OUTPUT, ALONE, WORKERS = range(8)
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


class WorkersError(PipelineError):
    """Workers were lost, again and again; an older output is intact, and the journal is kept."""

    exit_code = WORKERS


class Cancelled(PipelineError):
    """The observer asked for the end; an older output is intact, and the journal is kept."""

    exit_code = CANCELLED


_BY_CODE = {error.exit_code: error for error in (UsageError, InputError, OutputError, WorkersError)}
# A frame that fails is a record of the report; one that ends the run leaves nothing written.
_BY_CODE[FRAMES] = InputError


def plain_error(error: Exception) -> PipelineError:
    """Return the error of a run that stands for an exception of the libraries.

    Those that are raised on purpose carry an exit code as these do; others are defects.
    """
    if isinstance(error, PipelineError):
        return error
    code = getattr(error, "exit_code", None)
    if isinstance(code, int):
        known = _BY_CODE.get(code)
        return known(str(error)) if known is not None else PipelineError(str(error), code)
    if isinstance(error, MemoryError):
        return PipelineError(str(error) or "out of memory; choose fewer frames or prims")
    if isinstance(error, UnicodeEncodeError):  # bytes of a command line or file name
        return UsageError(f"{error.object!r} is no UTF-8 text; rename it")
    kind = type(error).__name__
    return PipelineError(
        f"internal error: {kind}: {error}; please report it with the output of -vv"
    )


@contextmanager
def plain_errors() -> Iterator[None]:
    """Raise what the libraries raise on purpose as the errors of a run, with them as the cause."""
    try:
        yield
    except PipelineError:
        raise
    except Exception as error:
        if hasattr(error, "exit_code"):
            raise plain_error(error) from error
        raise


def exit_code(report: Report) -> int:
    """Return the exit code of a run that has a report: CLEAN, REMAINING, FRAMES or ALONE."""
    if any(record.status == "failed" for record in report.frames):
        return FRAMES
    if report.alone_from is not None:
        return ALONE
    left = any(record.after is not None and record.after.pairs for record in report.frames)
    if report.command == "repair":  # which knows of parts wholly inside others, too
        left = any(record.status in ("improved", "unchanged") for record in report.frames)
    left = left or any(record.status == "strained" for record in report.frames)
    spans = report.keyposes.spans if report.keyposes is not None else ()
    return REMAINING if left or any(span.left for span in spans) else CLEAN
