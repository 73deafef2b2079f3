"""Options that are fields of a dataclass: name and default stand there, and there only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

import click

from dtrepair.pipeline.errors import UsageError
from dtrepair.repair.options import OptionError

Function = Callable[..., Any]


def field_option(kind: type, name: str, flag: str = "", **attributes: Any) -> Function:
    """Return an option for a field of a dataclass, with its default.

    flag: its names on the command line, where that is not --NAME; attributes: as `click.option` has
    them. A field that is true or false is a flag; one of a tuple may be given several times.
    """
    default = default_of(kind, name)
    if "type" not in attributes and isinstance(default, bool):
        attributes = {"is_flag": True, **attributes}
    elif isinstance(default, tuple):
        attributes = {"multiple": True, **attributes}
    elif default is not None:
        attributes = {"show_default": True, **attributes}
    return click.option(*(flag or flag_of(name)).split(), name, default=default, **attributes)


def expression_option(text: str) -> dict[str, Any]:
    """Return what `field_option` takes of a path expression, with its help.

    Given several times, on the command line or as a list in the file of --config, it is one
    expression of what any of them matches.
    """
    more = f"{text.removesuffix('.')}; may be given several times."
    return {"metavar": "EXPR", "multiple": True, "callback": _joined, "help": more}


def _joined(
    context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> str | None:
    """Return one path expression for several; None for none."""
    several = [f"({value})" for value in values or ()]
    return " + ".join(several) if len(several) > 1 else next(iter(values or ()), None)


def default_of(kind: type, name: str) -> Any:
    """Return the default of a field of a dataclass."""
    return getattr(kind(), name)


def as_object(
    kind: type,
    keyword: str,
    options: Mapping[str, Mapping[str, Any]],
    *,
    check: Callable[[Mapping[str, Any]], None] = lambda values: None,
) -> Callable[[Function], Function]:
    """Return a decorator that adds options, and gives them to the command as one object, `keyword`.

    options: by the names of the fields of `kind`, what `field_option` takes of each; fields without
    an option keep their defaults. check: called with the values, before they are made an object.
    """

    def decorate(function: Function) -> Function:
        @wraps(function)
        def wrapper(**values: Any) -> Any:
            own = {name: values.pop(name) for name in options}
            check(own)
            try:
                chosen = kind(**own)
            except OptionError as error:
                raise UsageError(f"{flag_of(error.option)} {error.reason}") from None
            return function(**{keyword: chosen}, **values)

        decorated: Function = wrapper
        for name in reversed(list(options)):
            decorated = field_option(kind, name, **options[name])(decorated)
        return decorated

    return decorate


def flag_of(name: str) -> str:
    """Return the name of a field on the command line."""
    return "--" + name.replace("_", "-")
