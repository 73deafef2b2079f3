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
    """Take defaults from the top of a TOML file and from the table named as the command."""
    if path is None:
        return
    import tomllib

    try:
        with open(path, "rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise click.BadParameter(f"{path}: cannot be read: {error.strerror}", context) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise click.BadParameter(f"{path}: is not TOML: {error}", context) from None
    command = context.info_name or ""
    values = {key: value for key, value in content.items() if not isinstance(value, dict)}
    own = content[command] if isinstance(content.get(command), dict) else {}
    for part in (values, own):
        if isinstance(part.get("prim"), dict | list):
            _keep_tables(context, part.pop("prim"), path)
    values |= own
    known = {_option_name(p): p for p in context.command.params if isinstance(p, click.Option)}
    found = {}
    for key, value in values.items():
        option = known.get(key.replace("_", "-"))
        if option is None or key == "config":
            raise click.BadParameter(f"{path}: {command} has no option {key!r}", context)
        found[option.name] = [value] if option.multiple and isinstance(value, str) else value
    context.default_map = {**(context.default_map or {}), **found}


def _option_name(option: click.Option) -> str:
    return max(option.opts, key=len).lstrip("-")


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
