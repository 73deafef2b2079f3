"""Options that are fields of a dataclass: name and default stand there, and there only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

import click

Function = Callable[..., Any]


def field_option(kind: type, name: str, flag: str = "", **attributes: Any) -> Function:
    """An option for a field of a dataclass, with its default.

    flag: its name on the command line, where that is not --NAME; attributes: as `click.option` has
    them. A field that is true or false is a flag; one of a tuple may be given several times.
    """
    default = default_of(kind, name)
    if "type" not in attributes and isinstance(default, bool):
        attributes = {"is_flag": True, **attributes}
    elif isinstance(default, tuple):
        attributes = {"multiple": True, **attributes}
    elif default is not None:
        attributes = {"show_default": True, **attributes}
    flag = flag or "--" + name.replace("_", "-")
    return click.option(flag, name, default=default, **attributes)


def default_of(kind: type, name: str) -> Any:
    """The default of a field of a dataclass."""
    return getattr(kind(), name)


def as_object(kind: type, keyword: str, options: Mapping[str, Function]) -> Function:
    """A decorator that adds options, and gives them to the command as one object, `keyword`.

    options: by the names of the fields of `kind`; fields without an option keep their defaults.
    """

    def decorate(function: Function) -> Function:
        @wraps(function)
        def wrapper(**values: Any) -> Any:
            chosen = kind(**{name: values.pop(name) for name in options})
            return function(**{keyword: chosen}, **values)

        decorated: Function = wrapper
        for option in reversed(list(options.values())):
            decorated = option(decorated)
        return decorated

    return decorate
