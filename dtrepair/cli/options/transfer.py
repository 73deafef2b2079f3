"""Options of a transfer, as `TransferOptions`."""

from __future__ import annotations

from typing import Any

import click

from dtrepair.cli.options.fields import Function, as_object
from dtrepair.pipeline.transfer.options import ALIGNMENTS, UP_AXES, TransferOptions

_UP = click.Choice(UP_AXES, case_sensitive=False)
_OPTIONS: dict[str, dict[str, Any]] = {
    "markers": {"metavar": "F", "help": "Vertex pairs: .cons, two columns of text, or npz."},
    "match": {
        "metavar": '"A,B[=F]"',
        "help": "Mesh B of TARGET follows mesh A of SOURCE, of the same topology or by markers F; "
        "may be given several times.",
    },
    "correspondence": {"metavar": "F", "help": "Triangle pairs: .tricorrs, text, or npz."},
    "save_correspondence": {"metavar": "F", "help": "Write the triangle pairs: npz or text."},
    "target_prim": {"metavar": "EXPR", "help": "The meshes of TARGET, as --prim for SOURCE."},
    "source_up": {"type": _UP, "help": "Up axis of SOURCE, where it does not say."},
    "target_up": {"type": _UP, "help": "Up axis of TARGET, where it does not say."},
    "align": {
        "type": click.Choice(ALIGNMENTS),
        "help": "Turn the motion as the up axes, or as the rest poses, lie to each other.",
    },
    "root_scale": {
        "type": click.FloatRange(min=0.0),
        "metavar": "X",
        "help": "Scale of the travel; default: the ratio of the heights.",
    },
    "ground": {"help": "Keep the lowest vertex on the source's ground."},
    "pin": {
        "metavar": "NAME|F.npz",
        "help": "Target vertices held at rest: primvar or GeomSubset; or npz of vertices, "
        "positions.",
    },
    "shapes": {
        "help": "Take --poses, or the blend shapes of SOURCE, as shapes; write UsdSkel blend "
        "shapes."
    },
    "picture": {"metavar": "F.png", "help": "Draw the registered source over the target."},
}


def transfer_options(function: Function) -> Function:
    """Add the options of the transfer; the command gets `transfer`, a `TransferOptions`."""
    return as_object(TransferOptions, "transfer", _OPTIONS)(function)
