"""How each object behaves: tables [[prim]] of --config, primvars of the stage, common options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.selection import (
    KEYS,
    NAMES,
    ObjectSettings,
    PrimTable,
    plain_value,
    wrong_value,
)
from dtrepair.pipeline.stages.matching import matching_meshes
from dtrepair.pipeline.stages.sources import Source, StageSource

# Primvars of a stage that speak to this program are in this namespace.
NAMESPACE = "dtrepair"


@dataclass
class SettingsOfMeshes:
    """Settings of each mesh, and warnings about what the stage holds."""

    each: list[ObjectSettings]
    warnings: list[str] = field(default_factory=list)


def read_settings(
    source: Source, *, rigid: str | None = None, tables: Sequence[PrimTable] = ()
) -> SettingsOfMeshes:
    """Settings of each mesh: a table wins, then a primvar of the stage, then `rigid`.

    Of several tables that match a mesh the last one counts, key by key.
    """
    result = SettingsOfMeshes([ObjectSettings() for _ in source.meshes])
    if rigid is not None:
        for index in matching_meshes(source, rigid, f"--rigid {rigid}"):
            result.each[index] = ObjectSettings(rigid=True)
    if isinstance(source, StageSource):
        for index, mesh in enumerate(source.meshes):
            values = _of_stage(mesh.path, mesh.handle, result.warnings)
            result.each[index] = replace(result.each[index], **values)
    for table in tables:
        given = {key: value for key, value in vars(table.settings).items() if value is not None}
        for index in matching_meshes(source, table.path, table.origin):
            result.each[index] = replace(result.each[index], **given)
    return result


def _of_stage(path: str, handle: Any, warnings: list[str]) -> dict[str, Any]:
    """Settings in the primvars of a mesh. Raises InputError; unknown ones are warned."""
    from usd_io.read.prim_settings import read_constants

    values = {}
    for name, value in read_constants(handle, NAMESPACE).items():
        where = f"{path}: {NAMESPACE}:{name}"
        if name not in KEYS:
            warnings.append(f"{where}: unknown; known are {', '.join(KEYS)}")
        elif name in NAMES:
            # The weights or vectors themselves, one for the mesh or one for each vertex.
            values[name] = f"{NAMESPACE}:{name}"
        else:
            if name == "rigid" and value in (0, 1):
                value = bool(value)
            if wrong := wrong_value(name, value):
                raise InputError(f"{where}: {wrong}")
            values[name] = plain_value(name, value)
    return values


def recorded(source: Source, each: Sequence[ObjectSettings]) -> dict[str, dict[str, Any]]:
    """What was asked of each mesh, for the report; those without settings are left out."""
    told = {}
    for mesh, own in zip(source.meshes, each, strict=True):
        values = {key: value for key, value in vars(own).items() if value is not None}
        if values:
            told[mesh.path] = values
    return told
