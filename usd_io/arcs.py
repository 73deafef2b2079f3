"""What the prims of a layer refer to: references, payloads and value clips."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from pxr import Sdf

# A set of variants, and the name of one.
Variant = tuple[str, str]


class Arc(NamedTuple):
    """An asset that a prim refers to.

    Attributes:
        asset: identifier of its layer.
        variants: the prim lies in these; they must all be selected.
        payload: whether it is composed only where payloads are loaded.
        clip: whether it is read for its samples alone, and composes nothing.
    """

    asset: str
    variants: frozenset[Variant]
    payload: bool = False
    clip: bool = False


def find_arcs(layer: Sdf.Layer) -> tuple[list[Arc], set[Variant]]:
    """Return the arcs of the prims of a layer, and the variants that it selects."""
    specs: list[Sdf.PrimSpec] = []

    def collect(path: Sdf.Path) -> None:
        if path.IsPrimPath() or path.IsPrimVariantSelectionPath():
            if spec := layer.GetPrimAtPath(path):
                specs.append(spec)

    layer.Traverse(Sdf.Path.absoluteRootPath, collect)
    arcs: list[Arc] = []
    selected = set[Variant]()
    for spec in specs:
        selected.update(spec.variantSelections.items())
        inside = frozenset(_variants(spec.path))
        for asset in _assets(spec.referenceList):
            arcs.append(Arc(layer.ComputeAbsolutePath(asset), inside))
        for asset in _assets(spec.payloadList):
            arcs.append(Arc(layer.ComputeAbsolutePath(asset), inside, payload=True))
        if spec.HasInfo("clips"):
            arcs += [Arc(asset, inside, clip=True) for asset in _clips(layer, spec)]
    return arcs, selected


def _variants(path: Sdf.Path) -> Iterable[Variant]:
    """Return the variants that a prim lies in."""
    return (p.GetVariantSelection() for p in path.GetPrefixes() if p.IsPrimVariantSelectionPath())


def _assets(edits: Any) -> list[str]:
    """Return the asset paths that a list of references or payloads adds."""
    return [item.assetPath for item in edits.GetAddedOrExplicitItems() if item.assetPath]


def _clips(layer: Sdf.Layer, spec: Sdf.PrimSpec) -> Iterator[str]:
    """Yield the layers of the value clips of a prim, and their manifests."""
    # What is of another type than it should be is left to the reader of USD.
    for values in spec.GetInfo("clips").values():
        if not isinstance(values, dict):
            continue
        paths = values.get("assetPaths")
        named = list(paths) if isinstance(paths, Sdf.AssetPathArray) else []
        for asset in [*named, values.get("manifestAssetPath")]:
            if isinstance(asset, Sdf.AssetPath) and asset.path:
                yield layer.ComputeAbsolutePath(asset.path)
        template = values.get("templateAssetPath")
        if isinstance(template, str) and template:
            yield from _numbered(os.path.join(os.path.dirname(layer.realPath), template), values)


def _numbered(template: str, values: dict[str, Any]) -> list[str]:
    """Return the files that a template stands for: digits, at least as many, for its `#`.

    Those from `templateStartTime` to `templateEndTime` of the clips: USD opens no others.
    """
    ends = [values.get(name) for name in ("templateStartTime", "templateEndTime")]
    low, high = (float(end) if isinstance(end, int | float) else None for end in ends)
    folder, name = os.path.split(os.path.normpath(template))
    parts = re.split("(#+)", name)
    if len(parts) > 5:  # USD knows one number, and one after its point
        return []
    pattern = "".join(
        rf"(\d{{{len(part)},}})" if part.startswith("#") else re.escape(part) for part in parts
    )
    try:
        names = sorted(os.listdir(folder))
    except OSError:
        return []
    found = []
    for item in names:
        if match := re.fullmatch(pattern, item):
            # `clip.007.usd`, or `clip.007.25.usd` for 7.25.
            time = float(".".join(match.groups()) or 0)
            if (low is None or time >= low) and (high is None or time <= high):
                found.append(os.path.join(folder, item))
    return found
