"""Options of the search between keys, as `KeyOptions`."""

from __future__ import annotations

from typing import Any

import click

from dtrepair.cli.options.fields import Function, as_object
from dtrepair.keyposes.options import INTERPOLATIONS, KeyOptions

_OPTIONS: dict[str, dict[str, Any]] = {
    "samples": {
        "type": click.IntRange(min=1),
        "metavar": "N",
        "help": "In-betweens that are looked at between two keys.",
    },
    "interpolation": {
        "type": click.Choice(INTERPOLATIONS),
        "help": "linear as USD interpolates, or a Catmull-Rom spline through the keys.",
    },
    "extra": {
        "flag": "--extra-keys",
        "type": click.IntRange(min=0),
        "metavar": "N",
        "help": "Most keys added between two keys.",
    },
    "keep_keys": {"help": "Never move a key for the sake of an in-between."},
}


def key_options(function: Function) -> Function:
    """Add the options of the search between keys; the command gets `keys`, a `KeyOptions`."""
    return as_object(KeyOptions, "keys", _OPTIONS)(function)
