"""The record of an output layer: what it lies over, and whether another program damaged it."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from usd_io.errors import StageError
from usd_io.read.stages import OpenedStage, as_stage
from usd_io.write.metadata import get_record

_PART = re.compile(r"([0-9]{1,9})/([0-9]{1,9})")


def repaired_stage(stage: OpenedStage | Usd.Stage) -> str:
    """Return the path of the stage that a layer of a repair lies over; "" for any other stage.

    Of a repair of a repaired stage, that of the first one.
    """
    layer: Sdf.Layer | None = as_stage(stage).GetRootLayer()
    found, seen = "", set[str]()
    while layer is not None and layer.identifier not in seen and _is_repair(layer):
        seen.add(layer.identifier)
        found = layer.ComputeAbsolutePath(layer.subLayerPaths[0])
        layer = Sdf.Layer.Find(found)
    return found


def repair_settings(stage: OpenedStage | Usd.Stage) -> dict[str, Any]:
    """Return the settings with which a layer was repaired; of any other stage none."""
    layer = as_stage(stage).GetRootLayer()
    return dict(get_record(layer)["settings"]) if _is_repair(layer) else {}


def _is_repair(layer: Sdf.Layer) -> bool:
    """Return whether a layer has repaired points of the one that it lies over, and not of others.

    A transfer gives a stage the motion of another one.
    """
    settings = get_record(layer).get("settings")
    if not isinstance(settings, Mapping) or len(layer.subLayerPaths) != 1:
        return False
    return "rest_contacts" in settings and "source_path" not in settings


def record_of(path: str | os.PathLike[str]) -> tuple[dict[str, Any], str]:
    """Return the record of a layer file, and the path of the one stage that it lies over.

    Without a record, or without such a stage, these are empty.
    """
    layer = Sdf.Layer.FindOrOpen(os.fspath(path))
    if layer is None:
        return {}, ""
    below = list(layer.subLayerPaths)
    return get_record(layer), layer.ComputeAbsolutePath(below[0]) if len(below) == 1 else ""


def check_record(path: str, record: Mapping[str, Any]) -> None:
    """Raise StageError, which names the layer and the entry, for a record of wrong types."""
    settings, written = record.get("settings", {}), record.get("written", {})
    for name, value, good in (
        ("settings", settings, isinstance(settings, Mapping)),
        ("written", written, isinstance(written, Mapping) and all(map(_times, written.values()))),
        ("frames", record.get("frames", ()), _times(record.get("frames", ()))),
        ("written_default", record.get("written_default", ()), _texts(record)),
    ):
        if not good:
            raise _damaged(path, name, value)
    part = settings.get("chunk")
    if part is not None and part_of(part) is None:
        raise _damaged(path, "settings:chunk", part)


def check_alike(
    first_path: str,
    first: Mapping[str, Any],
    path: str,
    other: Mapping[str, Any],
    differing: Collection[str],
) -> None:
    """Raise StageError for the records of two layers that one run would not have written.

    differing: settings in which they may differ, if none of them is a part of a split.
    """
    settings = first.get("settings", {}), other.get("settings", {})
    ignored = {"chunk"} if any("chunk" in own for own in settings) else {*differing}
    reasons = [
        f"{name} ({_told(settings[0], name)} and {_told(settings[1], name)})"
        for name in sorted({*settings[0], *settings[1]} - ignored)
        if settings[0].get(name) != settings[1].get(name)
    ]
    if first.get("version") != other.get("version"):
        reasons.insert(0, f"version ({_told(first, 'version')} and {_told(other, 'version')})")
    digests = [own.get("input_digest") for own in (first, other)]
    chunks = ["chunk" in own for own in settings]
    # Whole layers of other programs and versions may have none.
    if digests[0] != digests[1] and (all(chunks) or None not in digests):
        reasons.insert(0, "the content of the input")
    if any(chunks) and not all(chunks):
        reasons.insert(0, "that only one is a chunk")
    if reasons:
        raise StageError(
            f"{first_path} and {path} differ in {', '.join(reasons[:4])}; write them again, all "
            "with the same settings, version and input"
        )


def same_values(one: object, other: object) -> bool:
    """Return whether two values of records are the same, with arrays as lists."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return all(same_values(one.get(name), other.get(name)) for name in {*one, *other})
    if isinstance(one, str) or not isinstance(one, Iterable) or not isinstance(other, Iterable):
        return bool(one == other)
    return list(one) == list(other)


def _told(values: Mapping[str, Any], name: str) -> str:
    """Return a value of a record in a few words."""
    return str(values[name])[:40] if name in values else "none"


def part_of(text: object) -> tuple[int, int] | None:
    """Return the part K and the number N of parts of a text "K/N", 1 <= K <= N; else None."""
    match = _PART.fullmatch(text) if isinstance(text, str) else None
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        return None
    return int(match[1]), int(match[2])


def _times(value: object) -> bool:
    """Return whether a value is a row of finite numbers."""
    try:
        row = np.asarray(value)
    except (TypeError, ValueError):
        return False
    if row.ndim != 1 or (row.size and row.dtype.kind not in "fiu"):
        return False
    return not row.size or bool(np.isfinite(row).all())


def _texts(record: Mapping[str, Any]) -> bool:
    """Return whether the meshes changed at the default time are a row of texts."""
    value = record.get("written_default", ())
    if value is None or isinstance(value, str | Mapping | float):
        return False
    try:
        return all(isinstance(item, str) for item in value)
    except TypeError:
        return False


def _damaged(path: str, name: str, value: object) -> StageError:
    """Return the error of a wrong entry."""
    kind = "nothing" if value is None else type(value).__name__
    return StageError(
        f"{path}: entry {name!r} of its record is damaged (got {kind}); write the layer again"
    )
