"""Options that several commands share; each group reaches the command as one object."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from typing import Any

import click

from dtrepair.cli.options.config import read_config
from dtrepair.cli.terminal.console import Console
from dtrepair.pipeline.selection import ObjectOptions, Selection

Function = Callable[..., Any]


_SELECTION = (
    click.option("--frames", metavar="SPEC", help="Frames, such as 7, -5:10 or 1:100x2,200."),
    click.option("--prim", metavar="EXPR", help="Meshes to take: a path expression, /Hero//."),
    click.option("--exclude", metavar="EXPR", help="Meshes to leave out: a path expression."),
    click.option("--include-invisible", is_flag=True, help="Take invisible meshes too."),
    click.option("--include-purposes", is_flag=True, help="Take proxy and guide meshes too."),
    click.option("--skip-varying", is_flag=True, help="Skip meshes whose topology changes."),
    click.option("--uninstance", is_flag=True, help="Expand instances so that they can change."),
    click.option("--strict", is_flag=True, help="Refuse a stage with broken references."),
)


def selection_options(function: Function) -> Function:
    """Add the options that choose meshes and frames; the command gets `selection`."""

    @wraps(function)
    def wrapper(**options: Any) -> Any:
        names = Selection.__dataclass_fields__
        selection = Selection(**{name: options.pop(name) for name in names})
        return function(selection=selection, **options)

    return _with(wrapper, _SELECTION)


IGNORE = click.option(
    "--ignore",
    multiple=True,
    metavar='"A,B"',
    help="Two prims whose contacts do not count; may be given several times.",
)
_OBJECTS = (
    click.option("--collider", metavar="EXPR", help="Meshes that take part but never move."),
    click.option("--rigid", metavar="EXPR", help="Meshes that move as a whole only."),
    IGNORE,
    click.option(
        "--pin", metavar="NAME", help="Primvar (0 free to 1 fixed) or GeomSubset (fixed)."
    ),
    click.option(
        "--direction",
        metavar="NAME|SUBSET=x,y,z",
        help="Preferred direction of the repair, in world.",
    ),
)


def object_options(function: Function) -> Function:
    """Add the options that say how single meshes take part; the command gets `objects`."""

    @wraps(function)
    def wrapper(**options: Any) -> Any:
        names = ObjectOptions.__dataclass_fields__
        objects = ObjectOptions(**{name: options.pop(name) for name in names})
        return function(objects=objects, **options)

    return _with(wrapper, _OBJECTS)


def console_options(function: Function) -> Function:
    """Add -q and -v; the command gets `console`."""

    @wraps(function)
    def wrapper(*, quiet: bool, verbose: int, **options: Any) -> Any:
        return function(console=Console(quiet=quiet, verbosity=verbose), **options)

    return _with(
        wrapper,
        (
            click.option("-q", "--quiet", is_flag=True, help="Print errors only."),
            click.option("-v", "--verbose", count=True, help="Say more; -vv shows tracebacks."),
        ),
    )


def run_options(function: Function) -> Function:
    """Add --device and --config."""
    return _with(
        function,
        (
            click.option(
                "--device",
                default="auto",
                metavar="NAME",
                show_default=True,
                help="auto, cpu or cuda[:N].",
            ),
            click.option(
                "--config",
                metavar="F.toml",
                is_eager=True,
                expose_value=False,
                callback=read_config,
                help="Defaults of these options, by name, from a TOML file; and settings of single "
                "prims: [[prim]] path, diffusion, mobility, rigid, pin, direction.",
            ),
        ),
    )


def jobs_option(function: Function) -> Function:
    """Add --jobs; `jobs` arrives as a number."""

    @wraps(function)
    def wrapper(*, jobs: int | None, **options: Any) -> Any:
        return function(jobs=jobs or _cores(), **options)

    return _with(
        wrapper,
        (
            click.option(
                "--jobs",
                type=click.IntRange(min=1),
                metavar="N",
                help="Threads for frames side by side; default: all cores.",
            ),
        ),
    )


def _cores() -> int:
    """Cores that this process may use, fewer than the machine has in a container."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _with(function: Function, options: tuple[Function, ...]) -> Function:
    for option in reversed(options):
        function = option(function)
    return function
