"""The layers of a stage, made safe before the reader of USD opens them.

The reader maps files into memory: where a text layer is cut short while it is parsed, the process
is killed. So text is read whole first, and parsed from memory. Binary layers are not read here;
their tables are checked, whichever layer refers to them.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from pxr import Ar, Sdf

from usd_io.crate_check import check_crates
from usd_io.diagnostics import DAMAGE

_TEXT = b"#usda "
_TEXT_EXTENSIONS = (".usd", ".usda")


@dataclass(frozen=True)
class FoundLayers:
    """The layers that a layer is made of, its own included.

    Attributes:
        held: those that are open; USD finds them while they are held.
        sizes: number on its disk and bytes of each file, from before it was read.
    """

    held: list[Sdf.Layer] = field(default_factory=list)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)


def find_layers(path: str, *, payloads: bool = True) -> FoundLayers:
    """Open a layer and all that it refers to, far or near.

    Files that are missing or damaged are left out: the reader of USD tells of them. Of variants
    those are followed that a layer before selects: the others are not composed. Payloads are
    followed only if they will be loaded.

    Raises:
        StageError: a binary layer announces more than it can hold.
    """
    found, selected = FoundLayers(), set[tuple[str, str]]()
    waiting, seen = [Ar.GetResolver().CreateIdentifier(path)], set()
    while waiting:
        identifier = waiting.pop(0)  # the strongest first: its selections count
        file = Ar.GetResolver().Resolve(identifier).GetPathString().partition("[")[0]
        if identifier in seen or not os.path.isfile(file):
            continue
        seen.add(identifier)
        size = file_size(file)
        if file not in found.sizes and size is not None:
            found.sizes[file] = size
            with suppress(OSError):  # the reader of USD tells what cannot be read
                check_crates(file)
        layer = _opened(identifier)
        if layer is not None:
            found.held.append(layer)
            named = [*layer.subLayerPaths, *_composed(layer, selected, payloads)]
            waiting += [layer.ComputeAbsolutePath(asset) for asset in named]
    return found


def read_text(path: str) -> Sdf.Layer | None:
    """Return a text layer parsed from memory, as the file is now.

    None for other files, and for what cannot be read or parsed: the reader of USD tells why.
    """
    if not path.lower().endswith(_TEXT_EXTENSIONS):
        return None
    try:
        with open(path, "rb") as file:
            if file.read(len(_TEXT)) != _TEXT:
                return None
            file.seek(0)
            text = file.read().decode()
        form = Sdf.FileFormat.FindByExtension(path)
        layer = Sdf.Layer.Find(path) or Sdf.Layer.New(form, path)
        return layer if layer and layer.ImportFromString(text) else None
    except (OSError, *DAMAGE):
        return None


def file_size(path: str) -> tuple[int, int] | None:
    """Return the number of a file on its disk and its bytes; None if it is gone."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_ino, found.st_size


def _composed(layer: Sdf.Layer, selected: set[tuple[str, str]], payloads: bool) -> list[str]:
    """Return what the prims of a layer refer to; add the variants (set, name) that it selects."""
    specs: list[Sdf.PrimSpec] = []

    def collect(path: Sdf.Path) -> None:
        if path.IsPrimPath() or path.IsPrimVariantSelectionPath():
            if spec := layer.GetPrimAtPath(path):
                specs.append(spec)

    layer.Traverse(Sdf.Path.absoluteRootPath, collect)
    for spec in specs:
        selected.update(spec.variantSelections.items())
    chosen = [spec for spec in specs if _variants(spec.path) <= selected]
    lists = [spec.referenceList for spec in chosen]
    if payloads:
        lists += [spec.payloadList for spec in chosen]
    return [item.assetPath for items in lists for item in _items(items) if item.assetPath]


def _variants(path: Sdf.Path) -> set[tuple[str, str]]:
    """Return the variants (set, name) that a prim lies in."""
    return {p.GetVariantSelection() for p in path.GetPrefixes() if p.IsPrimVariantSelectionPath()}


def _items(edits: Any) -> list[Any]:
    """Return what a list of references or payloads adds."""
    return list(edits.GetAddedOrExplicitItems())


def _opened(identifier: str) -> Sdf.Layer | None:
    """Return the layer of an identifier; None where that is left to the reader of USD."""
    if layer := Sdf.Layer.Find(identifier):
        return layer
    if layer := read_text(identifier):
        return layer
    try:
        return Sdf.Layer.FindOrOpen(identifier)
    except DAMAGE:
        return None
