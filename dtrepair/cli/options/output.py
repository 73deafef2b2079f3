"""What a repair writes over a stage."""

from __future__ import annotations

from typing import Any

import click

from dtrepair.cli.options.fields import Function, as_object
from dtrepair.pipeline.repair.settings import NORMALS, OutputOptions

_OUTPUT: dict[str, dict[str, Any]] = {
    "shapes": {
        "help": "Write the correction as blend shapes with weights over time; characters stay "
        "bound to their rig.",
    },
    "delta": {"help": "Write offsets alone, as primvar dtrepair:offset."},
    "normals": {
        "type": click.Choice(NORMALS),
        "help": "Normals of changed meshes: made to follow, left as they are, or blocked, so that "
        "programs compute their own.",
    },
    "only_frames": {
        "help": "Write the frames of --frames alone; others hold the nearest of them.",
    },
}


def output_options(function: Function) -> Function:
    """Add the options of what is written; the command gets `writing`."""
    return as_object(OutputOptions, "writing", _OUTPUT)(function)
