"""Exit codes, and exceptions as one-line errors."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import Any

import click

CLEAN, REMAINING, USAGE, INPUT, FRAMES, OUTPUT = range(6)
INTERNAL = 70  # a defect of the program itself (EX_SOFTWARE)


class Failure(click.ClickException):
    """An error that ends the run with a code; the message says what, where and the cure."""

    def __init__(self, message: str, code: int) -> None:
        """Keep the message and the code."""
        super().__init__(message)
        self.code = code


def one_line_errors(function: Callable[..., int]) -> Callable[..., int]:
    """Turn the exceptions of a command into `Failure`s, unless `-v -v` or DTREPAIR_DEBUG is set."""

    @wraps(function)
    def wrapper(**options: Any) -> int:
        try:
            return function(**options)
        except (click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            console = options.get("console")
            if os.environ.get("DTREPAIR_DEBUG") or getattr(console, "verbosity", 0) > 1:
                raise
            raise as_failure(error) from error

    return wrapper


def as_failure(error: Exception) -> Failure:
    """Return the failure that stands for an exception of the libraries."""
    from dtrepair.files.mesh_files import MeshFileError

    code = getattr(error, "exit_code", None)  # the errors of usd_io carry theirs
    if isinstance(code, int):
        return Failure(str(error), code)
    if isinstance(error, MeshFileError):
        return Failure(str(error), INPUT)
    if isinstance(error, MemoryError):
        return Failure(str(error) or "out of memory; choose fewer frames or prims", INTERNAL)
    return Failure(
        f"internal error: {type(error).__name__}: {error}; please report it with the output of -vv",
        INTERNAL,
    )


def use_device(name: str) -> str:
    """Return the device that a --device option names; a usage error if it is not there."""
    from dtrepair.device import resolve_device

    try:
        return resolve_device(name)
    except ValueError as error:
        raise Failure(f"--device: {error}", USAGE) from None


def device_of_method(name: str, method: str) -> tuple[str, list[str]]:
    """Return where a method runs if --device names this device, and warnings."""
    if method != "full":
        return use_device(name), []
    if name == "auto" or use_device(name) == "cpu":
        return "cpu", []
    # Only counting there would cost the processes that the frames are shared out to.
    return "cpu", [
        f"--device {name}: the default method runs on the CPU (--method paper runs on the GPU)"
    ]


@contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[None]:
    """Turn an OSError while writing `path` into exit code 5."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise Failure(
            f"{path}: cannot be written: {reason}; choose another place", OUTPUT
        ) from None


def check_writable(path: str | os.PathLike[str]) -> None:
    """Refuse an output before any computing: no such directory, a directory, no permission."""
    from dtrepair.files.atomic import atomic_output

    target = Path(path)
    if target.is_dir():
        raise Failure(f"{path}: cannot be written: it is a directory; name a file", OUTPUT)
    try:
        # A trial without the last step: it leaves nothing behind.
        with writing(path), atomic_output(target):
            raise _TrialDone
    except _TrialDone:
        pass


class _TrialDone(Exception):
    """Ends the trial of `check_writable`."""


def refuse_overwriting(
    output: str | os.PathLike[str],
    *inputs: str | None,
    others: Iterable[str | None] = (),
) -> None:
    """Refuse an output that is one of the inputs, or of the `others`, outputs as well."""
    for what, names in (("an input", inputs), ("another output", others)):
        if any(name and os.path.realpath(name) == os.path.realpath(output) for name in names):
            raise Failure(f"{output}: is {what} of this run; choose another output", USAGE)
