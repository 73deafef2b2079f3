"""Which meshes and frames take part in a run, and how single meshes do; checked for all hosts."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from dtrepair.pipeline.errors import UsageError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Choices = TypeVar("Choices", bound="DataclassInstance")

NUMBERS = ("diffusion", "mobility")
NAMES = ("pin", "direction")
# Fields that outputs and reports of older versions do not hold.
_YOUNGER = ("samples_only", "strict_references")


@dataclass(frozen=True)
class Selection:
    """Which meshes and frames of the input take part.

    Args:
        frames: time codes, such as "7", "-5:10" or "1:100x2,200"; None: all whole frames of the
            range in which anything selected is animated, and samples between them.
        samples_only: take authored samples only, not the whole frames between them.
        prim: path expression of the meshes to take, such as "/Hero//"; None: all.
        exclude: path expression of meshes to leave out, or of groups: all below them.
        include_invisible: take invisible meshes too.
        include_purposes: take proxy and guide meshes too.
        skip_varying: skip meshes whose topology changes.
        uninstance: expand instances so that they can change.
        strict: refuse a stage with broken references; a check counts every contact as well,
            unless it is told how to.
        strict_references: refuse a stage with broken references, and nothing else.
    """

    frames: str | None = None
    samples_only: bool = False
    prim: str | None = None
    exclude: str | None = None
    include_invisible: bool = False
    include_purposes: bool = False
    skip_varying: bool = False
    uninstance: bool = False
    strict: bool = False
    strict_references: bool = False

    @property
    def recorded(self) -> dict[str, Any]:
        """What outputs and reports keep, by name; what is younger only where it was asked for."""
        return {n: v for n, v in vars(self).items() if v or n not in _YOUNGER}

    @property
    def whole_stages_only(self) -> bool:
        """Whether a stage with broken references is refused."""
        return self.strict or self.strict_references

    def given(self) -> list[str]:
        """Return the option names that were set."""
        return ["--" + name.replace("_", "-") for name, value in vars(self).items() if value]


@dataclass(frozen=True, kw_only=True)
class ObjectOptions:
    """How single meshes take part.

    Args:
        collider: path expression of meshes that take part but never move.
        rigid: path expression of meshes that move as a whole only.
        ignore: pairs "A,B" of path expressions whose contacts do not count.
        attach: pairs "A,B" of path expressions whose parts are attached to each other: contacts as
            they have in the bind pose, or else where they overlap least, are modelled. "A part 3"
            is one connected part, as lists name it; so of `detach`.
        detach: pairs "A,B" of path expressions whose parts are not attached to each other, whatever
            a pose shows: their contacts are faults. It wins over `attach`.
        layer: texts "A=N" of a path expression and a whole number; of two meshes with different
            ones, that with the higher lies farther out.
        pin: name of a primvar (0 free to 1 fixed) or GeomSubset (fixed).
        direction: name of a vector primvar, or "SUBSET=x,y,z": preferred direction, in world.
    """

    collider: str | None = None
    rigid: str | None = None
    ignore: tuple[str, ...] = ()
    attach: tuple[str, ...] = ()
    detach: tuple[str, ...] = ()
    layer: tuple[str, ...] = ()
    pin: str | None = None
    direction: str | None = None


@dataclass(frozen=True)
class ObjectSettings:
    """What is asked of one object; None: the common option holds.

    diffusion: how far a push spreads; mobility: from 0 (never moves) to 1; rigid: moves as a whole.
    pin and direction are names, as `ObjectOptions` takes them. attach, detach: path expressions of
    what it is attached to, and what it is not, or parts ("A part 3"). layer: a higher one lies
    farther out; a name: of a primvar with one per face.
    """

    diffusion: float | None = None
    mobility: float | None = None
    rigid: bool | None = None
    pin: str | None = None
    direction: str | None = None
    attach: tuple[str, ...] | None = None
    detach: tuple[str, ...] | None = None
    layer: int | str | None = None


# What can be asked of a single object, and which of it tells what is attached to what.
KEYS = tuple(key.name for key in fields(ObjectSettings))
CALLED = ("attach", "detach")


@dataclass(frozen=True)
class PrimTable:
    """Settings of the meshes that a path expression matches; `origin` names it in messages."""

    path: str
    settings: ObjectSettings = field(default_factory=ObjectSettings)
    origin: str = "[[prim]]"


def asking(tables: Iterable[PrimTable], keys: Collection[str]) -> list[PrimTable]:
    """Return those tables that ask for any of some keys."""
    return [own for own in tables if any(getattr(own.settings, key) is not None for key in keys)]


def parse_tables(tables: object, origin: str) -> tuple[PrimTable, ...]:
    """Check tables of settings, each with `path` and some of KEYS, as a TOML file holds them.

    origin: the file, for messages. Raises UsageError for an unknown key or a value out of range.
    """
    return tuple(
        _parsed(table, origin) for table in (tables if isinstance(tables, list) else [tables])
    )


def _parsed(table: object, origin: str) -> PrimTable:
    if not isinstance(table, Mapping) or not isinstance(table.get("path"), str):
        raise UsageError(f'{origin}: [[prim]] needs a path, such as path = "/World/Sword"')
    where = f"{origin}: [[prim]] {table['path']}"
    values = {key: value for key, value in table.items() if key != "path"}
    for key, value in values.items():
        if key not in KEYS:
            raise UsageError(f"{where}: has no {key!r}; known are {', '.join(KEYS)}")
        if wrong := wrong_value(key, value):
            raise UsageError(f"{where}: {wrong}")
    settings = {key: plain_value(key, value) for key, value in values.items()}
    return PrimTable(table["path"], ObjectSettings(**settings), where)


def wrong_value(name: str, value: object) -> str:
    """What is wrong with a value; empty where nothing is."""
    if name in CALLED:
        good = all(isinstance(each, str) and each.strip() for each in _listed(value))
        return "" if good else f"{name} should be path expressions, got {value!r}"
    if isinstance(value, np.ndarray):
        return f"{name} should be one value, got {len(value)}"
    if name == "layer":
        good = isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**31
        good |= isinstance(value, str) and bool(value)
        return "" if good else f"layer should be a whole number or a primvar, got {value!r}"
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


def plain_value(name: str, value: Any) -> Any:
    """A checked value of the type that `ObjectSettings` holds."""
    if name in CALLED:
        return tuple(str(each) for each in _listed(value))
    return float(value) if name in NUMBERS else value


def object_of(kind: type[Choices], values: Mapping[str, Any]) -> Choices:
    """An object of the values that have the names of its fields; a list of JSON is a tuple."""
    names = {key.name for key in fields(kind)}
    return kind(**{name: _as_tuple(value) for name, value in values.items() if name in names})


def recorded_tables(settings: Mapping[str, Any]) -> tuple[PrimTable, ...]:
    """Return tables of what a run asked of single meshes, given the `settings` of its report."""
    return tuple(
        PrimTable(path, object_of(ObjectSettings, own), path)
        for path, own in settings.get("objects", {}).items()
    )


def table_values(table: PrimTable) -> dict[str, Any]:
    """Return what a table asks for, as `recorded_tables` reads it."""
    values = {key: value for key, value in vars(table.settings).items() if value is not None}
    return {key: list(own) if isinstance(own, tuple) else own for key, own in values.items()}


def refuse_unknown(
    settings: Mapping[str, Any], kinds: Iterable[type[Any]], more: Iterable[str] = ()
) -> None:
    """Refuse settings with a name that is no field of these dataclasses, and none of `more`."""
    known = {*more, *(key.name for kind in kinds for key in fields(kind))}
    if unknown := sorted(settings.keys() - known):
        raise UsageError(f"settings: nothing here is called {unknown[0]!r}; of which run are they?")


def parse_layer(text: str) -> tuple[str, int]:
    """Path expression and number of a text "A=N". Raises UsageError for anything else."""
    pattern, _, number = text.rpartition("=")
    if not pattern.strip() or not number.strip().removeprefix("-").isdecimal():
        raise UsageError(
            f'--layer {text}: expected a prim and a whole number, such as "/Hero/Coat=2"'
        )
    return pattern.strip(), int(number)


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple | np.ndarray) else [value]


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
