"""-q and -v, which stand before a command as well as after it."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from dtrepair.cli.terminal.console import Console

Function = Callable[..., Any]


def verbosity_options(function: Function) -> Function:
    """Add -q and -v as they are, for the group."""
    verbose = click.option("-v", "--verbose", count=True, help="Say more; -vv shows tracebacks.")
    return click.option("-q", "--quiet", is_flag=True, help="Print errors only.")(verbose(function))


def console_options(function: Function) -> Function:
    """Add -q and -v; the command gets `console`, which heeds those before the command too."""

    @wraps(function)
    def wrapper(*, quiet: bool, verbose: int, **options: Any) -> Any:
        above = click.get_current_context().parent
        before = above.params if above is not None else {}
        console = Console(
            quiet=quiet or before.get("quiet", False),
            verbosity=verbose + before.get("verbose", 0),
        )
        return function(console=console, **options)

    return verbosity_options(wrapper)
