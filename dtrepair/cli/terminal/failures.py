"""Exceptions of a command as one-line errors."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from dtrepair.pipeline.errors import PipelineError, UsageError, plain_error

# Bytes of address space that the libraries take on two processors, before any mesh is read.
LEAST_SPACE = 19 * 2**30 // 10


def refuse_little_address_space() -> None:
    """Raise UsageError below a limit (`ulimit -v`) at which native libraries crash as they load."""
    if sys.platform == "win32":
        return
    import resource

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit != resource.RLIM_INFINITY and limit < LEAST_SPACE:
        raise UsageError(
            f"the limit of address space is {limit / 2**30:.2f} GiB; at least "
            f"{LEAST_SPACE / 2**30:.1f} GiB are needed, with many processors more: raise it "
            "(ulimit -v)"
        )


def one_line_errors(function: Callable[..., int]) -> Callable[..., int]:
    """Turn the exceptions of a command into plain ones, unless -vv or DTREPAIR_DEBUG is set."""

    @wraps(function)
    def wrapper(**options: Any) -> int:
        try:
            refuse_little_address_space()
            return function(**options)
        except (click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            # What a plain error stands for is where it came from.
            origin = error.__cause__ if isinstance(error, PipelineError) else error
            console = options.get("console")
            if origin is not None and (
                os.environ.get("DTREPAIR_DEBUG") or getattr(console, "verbosity", 0) > 1
            ):
                raise origin from None
            raise plain_error(error) from origin

    return wrapper
