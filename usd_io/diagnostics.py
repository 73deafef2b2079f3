"""Calls of pxr that print nothing and raise the errors of this package."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pxr import Tf, UsdUtils

from usd_io.errors import FrameError, StageError, one_line

# What pxr raises for damaged values: its own errors, text that is no UTF-8, sizes that no memory
# holds, and (CppException) a file that ends before the value.
DAMAGE = (Tf.ErrorException, Tf.CppException, UnicodeError, MemoryError, OverflowError)


@contextmanager
def no_diagnostics() -> Iterator[None]:
    """Keep warnings of pxr off the terminal; errors are exceptions anyway."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        delegate.TakeUncoalescedDiagnostics()
        del delegate


@contextmanager
def reading(where: str) -> Iterator[None]:
    """Read values of a stage in silence. Raises StageError that names `where` for damaged ones."""
    with no_diagnostics():
        try:
            yield
        except DAMAGE as error:
            raise StageError(f"{where}: {damage(error)}; export it again") from error


@contextmanager
def reading_frame(path: str, time: float) -> Iterator[None]:
    """Read values of one frame of a mesh in silence. Raises FrameError for damaged ones."""
    with no_diagnostics():
        try:
            yield
        except DAMAGE as error:
            raise FrameError(path, time, f"{damage(error)}; export it again") from error


def damage(error: BaseException) -> str:
    """Return what to say about values that cannot be read, in a few words."""
    huge = isinstance(error, MemoryError | OverflowError)
    return f"cannot be read ({'larger than the memory' if huge else one_line(error)})"
