"""Exceptions of a command as one-line errors; where its method runs."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from dtrepair.pipeline.errors import INTERNAL, InputError, PipelineError, UsageError


def one_line_errors(function: Callable[..., int]) -> Callable[..., int]:
    """Turn the exceptions of a command into plain ones, unless -vv or DTREPAIR_DEBUG is set."""

    @wraps(function)
    def wrapper(**options: Any) -> int:
        try:
            return function(**options)
        except (PipelineError, click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            console = options.get("console")
            if os.environ.get("DTREPAIR_DEBUG") or getattr(console, "verbosity", 0) > 1:
                raise
            raise as_plain_error(error) from error

    return wrapper


def as_plain_error(error: Exception) -> PipelineError:
    """Return the error with an exit code that stands for an exception of the libraries."""
    from dtrepair.files.mesh_files import MeshFileError

    code = getattr(error, "exit_code", None)  # the errors of usd_io carry theirs
    if isinstance(code, int):
        return PipelineError(str(error), code)
    if isinstance(error, MeshFileError):
        return InputError(str(error))
    if isinstance(error, MemoryError):
        return PipelineError(str(error) or "out of memory; choose fewer frames or prims", INTERNAL)
    return PipelineError(
        f"internal error: {type(error).__name__}: {error}; please report it with the output of -vv",
        INTERNAL,
    )


def use_device(name: str) -> str:
    """Return the device that a --device option names; a usage error if it is not there."""
    from dtrepair.device import resolve_device

    try:
        return resolve_device(name)
    except ValueError as error:
        raise UsageError(f"--device: {error}") from None


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
