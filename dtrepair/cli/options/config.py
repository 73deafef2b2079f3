"""--config: defaults of options by name, and tables [[prim]] of settings of single objects."""

from __future__ import annotations

from typing import Any

import click

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import PrimTable, parse_tables

_TABLES = "dtrepair.prim_tables"
# Bytes of a file and of a line: keys of thousands of parts take minutes and gigabytes to read.
MOST_BYTES, LONGEST_LINE = 2**20, 10_000


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
    if others and (unknown := sorted(others - _commands(context).keys())):
        known = ", ".join(f"[{name}]" for name in _commands(context))
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
        elif key in own or not _known_elsewhere(context, key):
            more = "" if key in own else ", nor has another command"
            raise click.BadParameter(f"{path}: {command} has no option {key!r}{more}", context)
    context.default_map = {**(context.default_map or {}), **found}


def _read(context: click.Context, path: str) -> dict[str, Any]:
    import tomllib

    try:
        with open(path, "rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES or max(map(len, data.split(b"\n"))) > LONGEST_LINE:
            limits = f"{MOST_BYTES} bytes, and {LONGEST_LINE} a line"
            raise click.BadParameter(f"{path}: expected up to {limits}, got more", context)
        return tomllib.loads(data.decode())
    except OSError as error:
        raise click.BadParameter(f"{path}: cannot be read: {error.strerror}", context) from None
    except ValueError as error:  # also of bytes that are no text, and of numbers without end
        raise click.BadParameter(f"{path}: is not TOML: {error}", context) from None
    except RecursionError:
        raise click.BadParameter(f"{path}: is nested too deeply", context) from None


def _commands(context: click.Context) -> dict[str, click.Command]:
    """Return the commands of the program that have --config."""
    above = context.find_root()
    group = above.command
    if not isinstance(group, click.Group):
        return {}
    every = {name: group.get_command(above, name) for name in group.list_commands(above)}
    return {
        name: command
        for name, command in every.items()
        if command is not None and any(own.name == "config" for own in command.params)
    }


def _options_of(command: click.Command) -> dict[str, click.Option]:
    """Return options that a file may hold, by their long name without dashes."""
    options = [own for own in command.params if isinstance(own, click.Option)]
    named = {max(option.opts, key=len).lstrip("-"): option for option in options}
    return {name: option for name, option in named.items() if name != "config"}


def _known_elsewhere(context: click.Context, key: str) -> bool:
    name = key.replace("_", "-")
    return any(name in _options_of(command) for command in _commands(context).values())


def _checked(context: click.Context, where: str, option: click.Option, value: Any) -> Any:
    """Return a value of the type that an option takes; several options of one name are a list."""
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
    """Keep the [[prim]] tables of a config file for the command."""
    try:
        checked = parse_tables(tables, path)
    except UsageError as error:
        raise click.BadParameter(str(error), context) from None
    context.meta[_TABLES] = (*context.meta.get(_TABLES, ()), *checked)


def kept_tables() -> tuple[PrimTable, ...]:
    """Return the [[prim]] tables of the command that is running."""
    found: tuple[PrimTable, ...] = click.get_current_context().meta.get(_TABLES, ())
    return found
