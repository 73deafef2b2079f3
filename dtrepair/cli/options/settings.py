"""All choices of a run as one object, the settings that `dtrepair.pipeline` takes."""

from __future__ import annotations

from dataclasses import fields
from functools import wraps
from typing import Any

from dtrepair.cli.options.config import kept_tables
from dtrepair.cli.options.fields import Function


def as_settings(kind: type, *options: Function) -> Function:
    """Return a decorator that adds options, and gives the command one object, `settings`.

    kind: the dataclass of the settings. Options that have the names of its fields go into it, those
    of the command itself as well, and the tables of --config. options: decorators that add some.
    """
    names = [own.name for own in fields(kind)]

    def decorate(function: Function) -> Function:
        @wraps(function)
        def wrapper(**values: Any) -> Any:
            own = {name: values.pop(name) for name in names if name in values}
            return function(settings=kind(**own, tables=kept_tables()), **values)

        decorated: Function = wrapper
        for option in reversed(options):
            decorated = option(decorated)
        return decorated

    return decorate
