"""Options of the repair method, as `RepairOptions`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import click
from click.core import ParameterSource

from dtrepair.cli.options.fields import Function, as_object
from dtrepair.intersect import MODES
from dtrepair.pipeline.errors import UsageError
from dtrepair.repair.options import (
    BRAKE_MASKS,
    ENERGIES,
    LAPLACIANS,
    METHODS,
    OPTIMIZERS,
    REST_CONTACTS,
    STAGES,
    RepairOptions,
)

# Options of the published loop alone; the full method has none of them.
_PAPER_ONLY = (
    "iterations",
    "regularization",
    "optimizer",
    "energy",
    "laplacian",
    "kernel_exponent",
    "kernel_power",
    "learning_rate",
    "brake_band",
    "brake_mask",
)

_OPTIONS: dict[str, dict[str, Any]] = {
    "method": {
        "type": click.Choice(METHODS),
        "help": "full, or the published algorithm alone.",
    },
    "mode": {
        "type": click.Choice(MODES),
        "help": "Contacts within a mesh, between meshes, or both.",
    },
    "diffusion": {"type": float, "metavar": "LAMBDA", "help": "How far a push spreads."},
    "tighten": {
        "type": int,
        "metavar": "ROUNDS",
        "help": "Rounds that pull a clean result back towards the input.",
    },
    "clearance": {
        "type": float,
        "metavar": "D",
        "help": "Distance that contacts keep, in stage units, but not within six edges along the "
        "surface, which on a coarse mesh is far. Where it is not reached, a warning names the "
        "frames; the exit code does not tell it.",
    },
    "maximum_displacement": {
        "type": float,
        "metavar": "D",
        "help": "No vertex moves farther, in stage units; default: no limit.",
    },
    "rest_contacts": {
        "type": click.Choice(REST_CONTACTS),
        "help": "Intersections that the rest pose has as well: those of different connected parts "
        "were modelled, and stay (auto); or repair, or leave, all of them.",
    },
    "inner_mobility": {
        "type": float,
        "metavar": "M",
        "help": "How freely what clothes lie over is pushed, next to them, from above 0 to 1: "
        "below 1 the body gives way less.",
    },
    "at_any_cost": {
        "help": "Keep what strains a shape beyond the bounds, else the best pose within them.",
    },
    "effort": {
        "type": float,
        "metavar": "FACTOR",
        "help": "Work on a pose, times what is usual, after which no other attempt begins: what is "
        "left then is told. Counted, not timed: the same results on any machine.",
    },
    "skip": {
        "flag": "--skip-stage",
        "type": click.Choice(STAGES),
        "help": "Leave a stage of the full method out; may be given several times.",
    },
    "iterations": {
        "type": int,
        "metavar": "N",
        "help": "Most iterations.",
    },
    "regularization": {
        "type": float,
        "metavar": "BETA",
        "help": "Weight of the shape.",
    },
    "optimizer": {"type": click.Choice(OPTIMIZERS), "help": "What makes steps of gradients."},
    "energy": {"type": click.Choice(ENERGIES), "help": "What is lowered."},
    "laplacian": {
        "type": click.Choice(LAPLACIANS),
        "help": "Pose that the Laplacian is of.",
    },
    "kernel_exponent": {
        "type": int,
        "metavar": "A",
        "help": "Of the height, odd; default: 1.",
    },
    "kernel_power": {
        "type": float,
        "metavar": "Q",
        "help": "Of the distance; default: 1.",
    },
    "learning_rate": {
        "type": float,
        "metavar": "RATE",
        "help": "Of the optimiser; default: what suits it.",
    },
    "brake_band": {
        "type": float,
        "metavar": "S",
        "help": "Of momentum-brake, standard deviations; default: 3.",
    },
    "brake_mask": {
        "type": click.Choice(BRAKE_MASKS),
        "help": "What momentum-brake stops: a component (default) or a vertex.",
    },
}
# Options of the full method alone.
_FULL_ONLY = (
    "tighten",
    "clearance",
    "maximum_displacement",
    "rest_contacts",
    "inner_mobility",
    "at_any_cost",
    "effort",
    "skip",
)
METHOD_NAMES = tuple(_OPTIONS)


def method_options(function: Function) -> Function:
    """Add the options of the method; the command gets `options`, a `RepairOptions`."""
    return as_object(RepairOptions, "options", _OPTIONS, check=_refuse)(function)


def _refuse(values: Mapping[str, Any]) -> None:
    """Refuse options that the chosen method would ignore."""
    method = values["method"]
    context = click.get_current_context()
    ignored = _FULL_ONLY if method == "paper" else _PAPER_ONLY
    for name in ignored:
        if context.get_parameter_source(name) != ParameterSource.DEFAULT:
            other = "full" if method == "paper" else "paper"
            option = name.replace("_", "-")
            raise UsageError(f"--{option}: has no effect with --method {method}; use {other}")
