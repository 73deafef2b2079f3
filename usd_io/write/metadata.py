"""Metadata of an output layer: that of the stage, and a record of how the layer was made."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Sdf, Usd, Vt

from usd_io.paths import relative_asset_path

# Composed from the input through the sublayer, or about the input's file rather than the stage.
NOT_COPIED = {
    "subLayers",
    "subLayerOffsets",
    "customLayerData",
    "comment",
    "documentation",
    "layerRelocates",
    "hasOwnedSubLayers",
    "owner",
    "primOrder",
}

RECORD = "dtrepair"
_ARRAYS = Vt.BoolArray | Vt.IntArray | Vt.DoubleArray | Vt.StringArray


def copy_stage_metadata(stage: Usd.Stage, layer: Sdf.Layer, directory: str) -> None:
    """Copy what only a root layer can say: time codes per second, up axis, units, default prim.

    timeCodesPerSecond is always authored as composed. Left out, it would rescale every time
    (input at 48 under a bare root: times x 0.5); framesPerSecond alone counts as it. Asset paths
    are made relative to the directory of the output.
    """
    source = stage.GetRootLayer()
    for key in sorted(source.pseudoRoot.ListInfoKeys()):
        if key in NOT_COPIED:
            continue
        value = source.pseudoRoot.GetInfo(key)
        if isinstance(value, Sdf.AssetPath):
            resolved = source.ComputeAbsolutePath(value.path)
            value = Sdf.AssetPath(relative_asset_path(resolved, directory))
        layer.pseudoRoot.SetInfo(key, value)
    layer.timeCodesPerSecond = stage.GetTimeCodesPerSecond()


def set_record(layer: Sdf.Layer, record: Mapping[str, Any]) -> None:
    """Store a record under customLayerData.dtrepair."""
    layer.customLayerData = {**layer.customLayerData, RECORD: usd_dictionary(record)}


def get_record(layer: Sdf.Layer) -> dict[str, Any]:
    """Return the record of a layer; empty if it has none."""
    record = layer.customLayerData.get(RECORD, {})
    return dict(record) if isinstance(record, dict) else {}


def usd_dictionary(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return nested plain Python and numpy values as a dictionary that a layer can store.

    None is left out; lists become typed arrays, with dictionaries in them as JSON; what a layer
    gave stays as it is; anything unknown becomes its text.
    """
    stored = {str(key): _usd_value(value) for key, value in values.items() if value is not None}
    return {key: value for key, value in stored.items() if value is not None}


def _usd_value(value: Any) -> Any:
    """Return a value in a type that a layer can store."""
    if isinstance(value, Mapping):
        return usd_dictionary(value)
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool | str | float | _ARRAYS):
        return value
    if isinstance(value, int):
        return value if abs(value) < 2**31 else float(value)
    if isinstance(value, np.ndarray):
        if not value.size and value.dtype.kind == "f":
            return Vt.DoubleArray()
        value = value.reshape(-1).tolist()
    if isinstance(value, list | tuple | set | frozenset):
        items = sorted(value) if isinstance(value, set | frozenset) else list(value)
        return _usd_array(items)
    return str(value)


def _usd_array(items: list[Any]) -> Any:
    """Return a list in a type that a layer can store."""
    if items and all(isinstance(item, bool) for item in items):
        return Vt.BoolArray(items)
    numbers = all(isinstance(item, int | float | np.number) for item in items)
    if items and numbers and all(isinstance(item, int) and abs(item) < 2**31 for item in items):
        return Vt.IntArray(items)
    if items and numbers:
        return Vt.DoubleArray([float(item) for item in items])
    return Vt.StringArray([_text(item) for item in items])


def _text(item: Any) -> str:
    """Return an item of a mixed list as text."""
    if not isinstance(item, Mapping):
        return str(item)
    return json.dumps(dict(item), default=str, ensure_ascii=False)
