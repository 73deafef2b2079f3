"""Options of the repair method, as `RepairOptions`."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import click
from click.core import ParameterSource

from dtrepair.pipeline.errors import UsageError

# Options of the published loop alone; the full method has none of them.
_PAPER_ONLY = ("iterations", "regularization", "optimizer", "energy")

_OPTIONS = (
    click.option(
        "--method",
        type=click.Choice(["full", "paper"]),
        default="full",
        show_default=True,
        help="full, or the published algorithm alone.",
    ),
    click.option(
        "--mode",
        type=click.Choice(["self", "inter", "both"]),
        default="both",
        show_default=True,
        help="Contacts within a mesh, between meshes, or both.",
    ),
    click.option(
        "--diffusion",
        type=float,
        default=99.0,
        show_default=True,
        metavar="LAMBDA",
        help="How far a push spreads.",
    ),
    click.option(
        "--tighten",
        type=int,
        default=4,
        show_default=True,
        metavar="ROUNDS",
        help="Rounds that pull a clean result back towards the input.",
    ),
    click.option(
        "--clearance",
        type=float,
        default=0.0,
        show_default=True,
        metavar="D",
        help="Distance that contacts keep, stage units.",
    ),
    click.option(
        "--maximum-displacement",
        type=float,
        metavar="D",
        help="No vertex moves farther, stage units; default: no limit.",
    ),
    click.option(
        "--rest-contacts",
        type=click.Choice(["repair", "leave"]),
        default="repair",
        show_default=True,
        help="What to do with intersections that the rest pose has as well.",
    ),
    click.option(
        "--skip-stage",
        "skip",
        multiple=True,
        type=click.Choice(["volume", "fill", "insist", "pull-back", "relax", "unbend"]),
        help="Leave a stage of the full method out; may be given several times.",
    ),
    click.option(
        "--iterations",
        type=int,
        default=60,
        show_default=True,
        metavar="N",
        help="Most iterations; --method paper.",
    ),
    click.option(
        "--regularization",
        type=float,
        default=1e6,
        show_default=True,
        metavar="BETA",
        help="Weight of the shape; --method paper.",
    ),
    click.option(
        "--optimizer",
        type=click.Choice(["momentum-brake", "uniform-adam", "gradient-descent"]),
        default="momentum-brake",
        show_default=True,
        help="--method paper.",
    ),
    click.option(
        "--energy",
        type=click.Choice(["signed-tpe", "tpe", "point-to-plane", "conical"]),
        default="signed-tpe",
        show_default=True,
        help="--method paper.",
    ),
)
# Options of the full method alone.
_FULL_ONLY = ("tighten", "clearance", "maximum_displacement", "rest_contacts", "skip")
METHOD_NAMES = ("method", "mode", "diffusion", *_FULL_ONLY, *_PAPER_ONLY)


def method_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of the method; the command gets `options`, a `RepairOptions`."""

    @wraps(function)
    def wrapper(**values: Any) -> Any:
        from dtrepair.repair.options import RepairOptions

        chosen = {name: values.pop(name) for name in METHOD_NAMES}
        _refuse_without_effect(chosen["method"])
        try:
            options = RepairOptions(**chosen)
        except ValueError as error:
            raise UsageError(f"--{_as_option(str(error))}") from None
        return function(options=options, **values)

    for option in reversed(_OPTIONS):
        wrapper = option(wrapper)
    return wrapper


def _refuse_without_effect(method: str) -> None:
    """Refuse options that the chosen method would ignore."""
    context = click.get_current_context()
    ignored = _FULL_ONLY if method == "paper" else _PAPER_ONLY
    for name in ignored:
        if context.get_parameter_source(name) != ParameterSource.DEFAULT:
            other = "full" if method == "paper" else "paper"
            option = name.replace("_", "-")
            raise UsageError(f"--{option}: has no effect with --method {method}; use {other}")


def _as_option(message: str) -> str:
    """A library's message about `some_option` as one about `some-option`."""
    name, space, rest = message.partition(" ")
    return name.replace("_", "-") + space + rest
