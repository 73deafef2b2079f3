"""Exceptions of a command as one-line errors."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from dtrepair.pipeline.errors import PipelineError, plain_error


def one_line_errors(function: Callable[..., int]) -> Callable[..., int]:
    """Turn the exceptions of a command into plain ones, unless -vv or DTREPAIR_DEBUG is set."""

    @wraps(function)
    def wrapper(**options: Any) -> int:
        try:
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
