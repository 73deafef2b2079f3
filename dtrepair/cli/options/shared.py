"""Options that several commands share; each group reaches the command as one object."""

from __future__ import annotations

from typing import Any

import click

from dtrepair.cli.options.config import read_config
from dtrepair.cli.options.fields import Function, as_object, expression_option, field_option
from dtrepair.cli.options.file_names import FILE
from dtrepair.pipeline.check_settings import COUNTED_APART, CheckSettings
from dtrepair.pipeline.selection import KEYS, ObjectOptions, Selection

_SELECTION: dict[str, dict[str, Any]] = {
    "frames": {
        "metavar": "SPEC",
        "help": "Frames, such as 7, -5:10 or 1:100x2,200; default: all whole frames from the first "
        "sample to the last, and samples between them.",
    },
    "samples_only": {
        "flag": "--samples --samples-only",
        "help": "Take authored samples only, not the whole frames between them.",
    },
    "prim": expression_option("Meshes to take: a path expression, /Hero//."),
    "exclude": expression_option("Meshes to leave out; a group: all below it."),
    "include_invisible": {"help": "Take invisible meshes too."},
    "include_purposes": {"help": "Take proxy and guide meshes too."},
    "skip_varying": {"help": "Skip meshes whose topology changes."},
    "uninstance": {"help": "Expand instances so that they can change."},
    "strict": {
        "help": "The same as --strict-references; it is not check --strict, which counts modelled "
        "contacts like all others, too."
    },
    "strict_references": {"help": "Refuse a stage with broken references."},
}
# What a check does with it besides: it counts what was modelled as well.
_STRICT_CHECK = (
    "Refuse a stage with broken references, and count modelled contacts like all others. "
    "Each alone: --strict-references, --rest-contacts repair."
)


def selection_options(function: Function) -> Function:
    """Add the options that choose meshes and frames; the command gets `selection`."""
    return as_object(Selection, "selection", _SELECTION)(function)


def check_selection_options(function: Function) -> Function:
    """Add them for a check, in which --strict counts every contact as well."""
    own = {**_SELECTION, "strict": {"help": _STRICT_CHECK}}
    return as_object(Selection, "selection", own)(function)


def key_selection_options(function: Function) -> Function:
    """Add those that choose meshes and keys: samples, so that nothing lies between them."""
    own = {name: option for name, option in _SELECTION.items() if name != "samples_only"}
    own["frames"] = {**own["frames"], "help": "Keys, such as 7, -5:10 or 1:100x2,200."}
    return as_object(Selection, "selection", own)(function)


_IGNORE = {
    "metavar": '"A,B"',
    "help": "Two prims whose contacts do not count; may be given several times.",
}
_ATTACH = {
    "metavar": '"A,B"',
    "help": "Two prims whose parts are attached, or parts ('/A part 3'): contacts as in the bind "
    "pose, or else as where they overlap least, are modelled; may be given several times.",
}
_DETACH = {
    "metavar": '"A,B"',
    "help": "Two prims whose parts are not attached, or parts ('/A part 3'), whatever the bind "
    "pose shows: their contacts are faults; may be given several times.",
}
IGNORE = field_option(ObjectOptions, "ignore", **_IGNORE)
ATTACH = field_option(ObjectOptions, "attach", **_ATTACH)
DETACH = field_option(ObjectOptions, "detach", **_DETACH)
# Whether contacts that were modelled are told from others, of what counts and repairs nothing.
REST_CONTACTS = click.option(
    "--rest-contacts",
    type=click.Choice(COUNTED_APART),
    default=CheckSettings.rest_contacts,
    show_default="auto, with --strict repair",
    help="Contacts of different parts that the rest pose has as well were modelled: auto counts "
    "them apart, repair like all others. Wins over --strict.",
)
_OBJECTS: dict[str, dict[str, Any]] = {
    "collider": expression_option("Meshes that take part but never move."),
    "rigid": expression_option("Meshes that move as a whole only."),
    "ignore": _IGNORE,
    "attach": _ATTACH,
    "detach": _DETACH,
    "layer": {
        "metavar": '"A=N"',
        "help": "How far out prims lie, a whole number: of two layers the higher one is outside; "
        "may be given several times.",
    },
    "pin": {"metavar": "NAME", "help": "Primvar (0 free to 1 fixed) or GeomSubset (fixed)."},
    "direction": {
        "metavar": "NAME|SUBSET=x,y,z",
        "help": "Preferred direction of the repair, in world.",
    },
}


# Those of them that a transfer has: it has pins of its own, and knows no directions.
SCENE_NAMES = ("collider", "rigid", "ignore", "attach", "detach", "layer")


def scene_options(function: Function) -> Function:
    """Add the options of a scene that is moved and repaired; the command gets `objects`."""
    chosen = {name: _OBJECTS[name] for name in SCENE_NAMES}
    return as_object(ObjectOptions, "objects", chosen)(function)


def object_options(function: Function) -> Function:
    """Add the options that say how single meshes take part; the command gets `objects`."""
    return as_object(ObjectOptions, "objects", _OBJECTS)(function)


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
                type=FILE,
                metavar="F.toml",
                is_eager=True,
                expose_value=False,
                callback=read_config,
                help="Defaults of these options, by name, from a TOML file; and settings of single "
                f"prims: [[prim]] {', '.join(('path', *KEYS))}.",
            ),
        ),
    )


def jobs_option(function: Function) -> Function:
    """Add --jobs; None is all processors."""
    return click.option(
        "--jobs",
        type=click.IntRange(min=1),
        metavar="N",
        help="Threads for frames side by side; default: all cores.",
    )(function)


def _with(function: Function, options: tuple[Function, ...]) -> Function:
    for option in reversed(options):
        function = option(function)
    return function
