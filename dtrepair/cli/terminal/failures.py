"""Exceptions of a command as one-line errors."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from dtrepair.pipeline.errors import INTERNAL, InputError, PipelineError


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
