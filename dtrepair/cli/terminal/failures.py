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
        except (PipelineError, click.ClickException, click.Abort, click.exceptions.Exit):
            raise
        except Exception as error:
            console = options.get("console")
            if os.environ.get("DTREPAIR_DEBUG") or getattr(console, "verbosity", 0) > 1:
                raise
            raise plain_error(error) from error

    return wrapper
