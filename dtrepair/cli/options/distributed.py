"""--distributed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import click


def distributed_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --distributed; None where it is not given, or empty."""
    return click.option(
        "--distributed",
        metavar="ADDRESS|local",
        callback=lambda context, parameter, value: value or None,
        help="Repair on the workers of a Dask scheduler, or of one started here.",
    )(function)
