"""Options of a transfer, as `TransferOptions`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import wraps
from typing import Any

import click
from click.core import ParameterSource

from dtrepair.cli.options.config import kept_tables
from dtrepair.cli.options.fields import Function, as_object, expression_option
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.method import METHOD_NAMES, method_options
from dtrepair.cli.options.shared import SCENE_NAMES, key_selection_options, scene_options
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.transfer.options import ALIGNMENTS, UP_AXES, TransferOptions
from dtrepair.pipeline.transfer.settings import TransferSettings

_UP = click.Choice(UP_AXES, case_sensitive=False)
_OPTIONS: dict[str, dict[str, Any]] = {
    "markers": {
        "type": FILE,
        "metavar": "F",
        "help": "Vertex pairs: .cons, two columns of text, or npz.",
    },
    "match": {
        "metavar": '"A,B[=F]"',
        "help": "Mesh B of TARGET follows mesh A of SOURCE, of the same topology or by markers F; "
        "may be given several times.",
    },
    "correspondence": {
        "type": FILE,
        "metavar": "F",
        "help": "Triangle pairs: .tricorrs, text, or npz.",
    },
    "save_correspondence": {
        "type": FILE,
        "metavar": "F",
        "help": "Write the triangle pairs: npz or text.",
    },
    "target_prim": expression_option("The meshes of TARGET, as --prim for SOURCE."),
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
    "registration": {
        "type": FILE,
        "metavar": "F.png",
        "help": "Draw the registered source over the target.",
    },
}


# What the command has beside the options here, and its settings hold.
_OWN = ("poses", "rest", "repair", "alone")


def transfer_settings(function: Function) -> Function:
    """Add the options of transfer, scene and method; the command gets `settings`.

    The command has --poses, --rest, --repair and --alone beside them.
    """

    @wraps(function)
    def wrapper(**values: Any) -> Any:
        names = ("selection", "transfer", "options", "objects", *_OWN)
        own = {name: values.pop(name) for name in names}
        return function(settings=_settings(own), **values)

    decorated = scene_options(key_selection_options(method_options(wrapper)))
    return as_object(TransferOptions, "transfer", _OPTIONS)(decorated)


def _settings(chosen: Mapping[str, Any]) -> TransferSettings:
    """Return the settings of a transfer; what only a repair has counts with --repair."""
    repair = chosen["repair"]
    if not repair:
        _refuse_without_repair()
    return TransferSettings(
        selection=chosen["selection"],
        options=chosen["transfer"],
        poses=chosen["poses"],
        rest=chosen["rest"],
        repair=chosen["options"] if repair else None,
        objects=chosen["objects"],
        tables=kept_tables() if repair else (),
        alone=chosen["alone"] if repair else None,
    )


def _refuse_without_repair() -> None:
    """Refuse options that only a repair has; a file of --config may serve `repair` as well."""
    context = click.get_current_context()
    for name in (*METHOD_NAMES, *SCENE_NAMES, "alone"):
        if context.get_parameter_source(name) == ParameterSource.COMMANDLINE:
            option = name.replace("_", "-")
            raise UsageError(f"--{option}: has no effect without --repair")
