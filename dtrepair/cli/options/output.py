"""What a repair writes over a stage."""

from __future__ import annotations

from typing import Any

from dtrepair.cli.options.fields import Function, as_object
from dtrepair.pipeline.repair.settings import OutputOptions

_OUTPUT: dict[str, dict[str, Any]] = {
    "shapes": {
        "help": "Write the correction as blend shapes with weights over time; characters stay "
        "bound to their rig.",
    },
    "delta": {"help": "Write offsets alone, as primvar dtrepair:offset."},
}


def output_options(function: Function) -> Function:
    """Add the options of what is written; the command gets `writing`."""
    return as_object(OutputOptions, "writing", _OUTPUT)(function)
