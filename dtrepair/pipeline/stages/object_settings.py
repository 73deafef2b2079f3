"""How each object behaves: tables [[prim]] of --config, primvars of the stage, common options."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.selection import (
    KEYS,
    NAMES,
    ObjectSettings,
    PrimTable,
    parse_layer,
    plain_value,
    wrong_value,
)
from dtrepair.pipeline.stages.matching import matching_meshes
from dtrepair.pipeline.stages.sources import Source, StageSource
from dtrepair.wording import listed

# Primvars of a stage that speak to this program are in this namespace.
NAMESPACE = "dtrepair"
# What is in it for other programs: the offsets that --delta writes.
WRITTEN = ("offset",)


@dataclass
class SettingsOfMeshes:
    """Settings of each mesh, who asked for them by their names, and warnings on the stage."""

    each: list[ObjectSettings]
    origins: list[dict[str, str]]
    warnings: list[str] = field(default_factory=list)


def read_settings(
    source: Source,
    *,
    rigid: str | None = None,
    layers: Sequence[str] = (),
    tables: Sequence[PrimTable] = (),
    keys: Collection[str] = KEYS,
) -> SettingsOfMeshes:
    """Settings of each mesh: a table wins, then a primvar of the stage, then `rigid` and `layers`.

    Of several tables, or texts of `layers`, that match a mesh the last one counts, key by key.
    keys: what is read; of the others nothing is looked at, or refused.
    """
    every = source.meshes
    result = SettingsOfMeshes([ObjectSettings() for _ in every], [{} for _ in every])

    def add(meshes: Iterable[int], given: Mapping[str, Any], origin: str) -> None:
        for index in meshes:
            result.each[index] = replace(result.each[index], **given)
            result.origins[index] |= dict.fromkeys(given, origin)

    if rigid is not None:
        option = f"--rigid {rigid}"
        add(matching_meshes(source, rigid, option), {"rigid": True}, option)
    for text in layers:
        pattern, number = parse_layer(text)
        option = f"--layer {text}"
        add(matching_meshes(source, pattern, option), {"layer": number}, option)
    if isinstance(source, StageSource):
        for index, mesh in enumerate(source.meshes):
            add([index], _of_stage(mesh.path, mesh.handle, keys, result.warnings), mesh.path)
    for table in tables:
        given = {key: value for key in keys if (value := getattr(table.settings, key)) is not None}
        add(matching_meshes(source, table.path, table.origin), given, table.origin)
    return result


def _of_stage(path: str, handle: Any, keys: Collection[str], warnings: list[str]) -> dict[str, Any]:
    """Settings in the primvars of a mesh. Raises InputError; unknown ones are warned."""
    from usd_io.read.prim_settings import read_constants

    values: dict[str, Any] = {}
    for name, value in read_constants(handle, NAMESPACE).items():
        where = f"{path}: {NAMESPACE}:{name}"
        if name in WRITTEN:
            continue
        if name not in KEYS:
            warnings.append(f"{where}: unknown; known are {', '.join(KEYS)}")
        elif name not in keys:
            continue
        elif name in NAMES or (name == "layer" and isinstance(value, np.ndarray)):
            # The weights, vectors or numbers themselves, one for each vertex or face.
            values[name] = f"{NAMESPACE}:{name}"
        else:
            if name == "rigid" and value in (0, 1):
                value = bool(value)
            if wrong := wrong_value(name, value):
                raise InputError(f"{where}: {wrong}")
            values[name] = plain_value(name, value)
    return values


def rigid_without_effect(source: Source, found: SettingsOfMeshes) -> list[str]:
    """Return a warning for each one who asks colliders to move as a whole, which never move."""
    asked: dict[str, list[str]] = {}
    for mesh, own, by in zip(source.meshes, found.each, found.origins, strict=True):
        if mesh.collider and own.rigid:
            asked.setdefault(by["rigid"], []).append(mesh.path)
    return [
        f"{origin}: rigid has no effect on colliders, which never move: {listed(paths)}"
        for origin, paths in asked.items()
    ]


def recorded(source: Source, each: Sequence[ObjectSettings]) -> dict[str, dict[str, Any]]:
    """What was asked of each mesh, for the report; those without settings are left out."""
    told = {}
    for mesh, own in zip(source.meshes, each, strict=True):
        values = {key: value for key, value in vars(own).items() if value is not None}
        values |= {key: list(value) for key, value in values.items() if isinstance(value, tuple)}
        if values:
            told[mesh.path] = values
    return told
