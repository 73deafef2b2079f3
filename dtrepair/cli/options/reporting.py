"""What is told of a run besides its output: `--report` and `--picture`, the same everywhere."""

from __future__ import annotations

from functools import wraps
from typing import Any

import click

from dtrepair.cli.options.fields import Function
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.terminal.outputs import Reports


def report_options(*names: str) -> Function:
    """Return a decorator that adds --report, with more `names`, and --picture.

    The command gets both as one object, `reports`.
    """

    def decorate(function: Function) -> Function:
        @wraps(function)
        def wrapper(report_paths: tuple[str, ...], picture: str | None, **values: Any) -> Any:
            return function(reports=Reports(report_paths, picture), **values)

        decorated = click.option(
            "--picture",
            type=FILE,
            metavar="F.png",
            help="Draw the worst contacts, before and after.",
        )(wrapper)
        return click.option(
            "--report",
            *names,
            "report_paths",
            type=FILE,
            multiple=True,
            metavar="F.json|F.html|-",
            help="Write a report: JSON, as .html a page to look at; - is stdout. May be given "
            "several times.",
        )(decorated)

    return decorate
