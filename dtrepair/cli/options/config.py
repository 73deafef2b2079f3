"""--config: defaults of options by name, and tables [[prim]] of settings of single objects."""

from __future__ import annotations

import math
from typing import Any

import click
import numpy as np

NUMBERS = ("diffusion", "mobility")
NAMES = ("pin", "direction")
# What can be asked of a single object.
KEYS = (*NUMBERS, "rigid", *NAMES)
_TABLES = "dtrepair.prim_tables"


def read_config(context: click.Context, parameter: click.Parameter, path: str | None) -> None:
    """Take defaults from the top of a TOML file and from the table named as the command.

    The top may hold what other commands know; the command's own table may not.
    """
    if path is None:
        return
    content = _read(context, path)
    command = context.info_name or ""
    own = content[command] if isinstance(content.get(command), dict) else {}
    for part in (content, own):
        if isinstance(part.get("prim"), dict | list):
            _keep_tables(context, part.pop("prim"), path)
    tables = {name for name, value in content.items() if isinstance(value, dict)}
    others = tables - {command}
    if others and (unknown := sorted(others - _commands().keys())):
        known = ", ".join(f"[{name}]" for name in _commands())
        raise click.BadParameter(
            f"{path}: [{unknown[0]}] is no command that has --config; known are {known} and "
            "[[prim]]",
            context,
        )
    top = {name: value for name, value in content.items() if name not in tables}
    options = _options_of(context.command)
    found = {}
    for key, value in {**top, **own}.items():
        option = options.get(key.replace("_", "-"))
        if option is not None:
            found[option.name] = _checked(context, f"{path}: {key}", option, value)
        elif key in own or not _known_elsewhere(key):
            more = "" if key in own else ", nor has another command"
            raise click.BadParameter(f"{path}: {command} has no option {key!r}{more}", context)
    context.default_map = {**(context.default_map or {}), **found}


def _read(context: click.Context, path: str) -> dict[str, Any]:
    import tomllib

    try:
        with open(path, "rb") as file:
            return tomllib.load(file)
    except OSError as error:
        raise click.BadParameter(f"{path}: cannot be read: {error.strerror}", context) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise click.BadParameter(f"{path}: is not TOML: {error}", context) from None


def _commands() -> dict[str, click.Command]:
    """The commands that have --config."""
    from dtrepair.cli.app import COMMANDS, group

    context = click.Context(group)
    every = {name: group.get_command(context, name) for name in COMMANDS}
    return {
        name: command
        for name, command in every.items()
        if command is not None and any(own.name == "config" for own in command.params)
    }


def _options_of(command: click.Command) -> dict[str, click.Option]:
    """Options that a file may hold, by their long name without dashes."""
    options = [own for own in command.params if isinstance(own, click.Option)]
    named = {max(option.opts, key=len).lstrip("-"): option for option in options}
    return {name: option for name, option in named.items() if name != "config"}


def _known_elsewhere(key: str) -> bool:
    return any(key.replace("_", "-") in _options_of(command) for command in _commands().values())


def _checked(context: click.Context, where: str, option: click.Option, value: Any) -> Any:
    """A value of the type that an option takes; several options of one name are a list."""
    if option.multiple:
        items = value if isinstance(value, list) else [value]
        return [_single(context, where, option, item) for item in items]
    return _single(context, where, option, value)


def _single(context: click.Context, where: str, option: click.Option, value: Any) -> Any:
    kind: Any
    if option.is_flag and not option.count:
        kind, expected = bool, "true or false"
    elif isinstance(option.type, click.types.IntParamType):
        kind, expected = int, "a whole number"
    elif isinstance(option.type, click.types.FloatParamType):
        kind, expected = int | float, "a number"
    else:
        kind, expected = str | int | float, "text"
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise click.BadParameter(f"{where} should be {expected}, got {value!r}", context)
    return str(value) if expected == "text" else value


def _keep_tables(context: click.Context, tables: object, path: str) -> None:
    """Keep the [[prim]] tables of a config file until the input is open."""
    checked = []
    for table in tables if isinstance(tables, list) else [tables]:
        if not isinstance(table, dict) or not isinstance(table.get("path"), str):
            raise click.BadParameter(
                f'{path}: [[prim]] needs a path, such as path = "/World/Sword"', context
            )
        where = f"{path}: [[prim]] {table['path']}"
        for key, value in table.items():
            if key not in ("path", *KEYS):
                known = ", ".join(KEYS)
                raise click.BadParameter(f"{where}: has no {key!r}; known are {known}", context)
            if key != "path" and (wrong := wrong_value(key, value)):
                raise click.BadParameter(f"{where}: {wrong}", context)
        checked.append((where, table))
    context.meta[_TABLES] = [*context.meta.get(_TABLES, ()), *checked]


def kept_tables() -> list[tuple[str, dict[str, Any]]]:
    """The [[prim]] tables of this run, each with the place where it stands."""
    context = click.get_current_context(silent=True)
    return context.meta.get(_TABLES, []) if context else []


def wrong_value(name: str, value: object) -> str:
    """What is wrong with a value; empty where nothing is."""
    if isinstance(value, np.ndarray):
        return f"{name} should be one value, got {len(value)}"
    if name == "rigid":
        return "" if isinstance(value, bool) else f"rigid should be true or false, got {value!r}"
    if name in NAMES:
        return "" if isinstance(value, str) else f"{name} should be a name, got {value!r}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"{name} should be a number, got {value!r}"
    if name == "mobility":
        return "" if 0.0 <= value <= 1.0 else f"mobility should be from 0 to 1, got {value}"
    good = 0.0 < value < math.inf
    return "" if good else f"diffusion should be positive and finite, got {value}"
