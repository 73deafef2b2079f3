"""The layers of a stage, made safe before the reader of USD opens them.

The reader maps files into memory: where one is cut short while it is parsed, the process is killed.
So text is read whole first, and parsed from memory; packages are opened under a lease. Binary
layers are not read here; their tables are checked, whichever layer refers to them.
"""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field

from pxr import Ar, Sdf

from usd_io.arcs import Arc, Variant, find_arcs
from usd_io.crate_check import check_crates
from usd_io.diagnostics import DAMAGE
from usd_io.errors import StageError
from usd_io.lease import uncut

_TEXT = b"#usda "
_TEXT_EXTENSIONS = (".usd", ".usda")


@dataclass(frozen=True)
class FoundLayers:
    """The layers that a layer is made of, its own included.

    Attributes:
        held: those that are open; USD finds them while they are held.
        sizes: number on its disk and bytes of each file, from before it was read.
        clips: those of value clips by file, None where damaged. No layer of the stage holds them:
            USD asks for one when it needs its samples.
    """

    held: list[Sdf.Layer] = field(default_factory=list)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    clips: dict[str, Sdf.Layer | None] = field(default_factory=dict)


def find_layers(path: str, *, payloads: bool = True) -> FoundLayers:
    """Open a layer and all that it refers to, far or near.

    Files that are missing or damaged are left out: the reader of USD tells of them. Of variants
    those are followed that any of the layers selects: the others are not composed. Payloads are
    followed only if they will be loaded.

    Raises:
        StageError: a binary layer announces more than it can hold; a text layer is no UTF-8.
    """
    found, selected, seen = FoundLayers(), set[Variant](), set[tuple[str, bool]]()
    waiting = [Arc(Ar.GetResolver().CreateIdentifier(path), frozenset())]
    while ready := [arc for arc in waiting if arc.variants <= selected]:
        waiting = [arc for arc in waiting if not arc.variants <= selected]
        for arc in ready:
            known = arc.asset, arc.clip
            if known in seen or (arc.payload and not payloads):
                continue
            seen.add(known)
            layer = _found(arc, found)
            if layer is None or arc.clip:
                continue
            arcs, chosen = find_arcs(layer)
            layers = [layer.ComputeAbsolutePath(name) for name in layer.subLayerPaths]
            waiting += [*(Arc(name, frozenset()) for name in layers), *arcs]
            selected |= chosen
    return found


def read_text(path: str) -> Sdf.Layer | None:
    """Return a text layer parsed from memory, as the file is now.

    None for other files, and for what cannot be read or parsed: the reader of USD tells why.
    Raises StageError for text that is no UTF-8, of which that reader does not tell.
    """
    if not path.lower().endswith(_TEXT_EXTENSIONS):
        return None
    try:
        with open(path, "rb") as file:
            if file.read(len(_TEXT)) != _TEXT:
                return None
            file.seek(0)
            text = _decoded(path, file.read())
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


def _found(arc: Arc, found: FoundLayers) -> Sdf.Layer | None:
    """Return the layer of an arc, checked and added to those found; None where there is none."""
    resolved = Ar.GetResolver().Resolve(arc.asset).GetPathString()
    file = resolved.partition("[")[0]
    if not os.path.isfile(file):
        return None
    size = file_size(file)
    if file not in found.sizes and size is not None:
        found.sizes[file] = size
        with suppress(OSError):  # the reader of USD tells what cannot be read
            check_crates(file)
    layer = _opened(arc.asset, resolved, file)
    if arc.clip:
        found.clips[file] = layer
    elif layer is not None:
        found.held.append(layer)
    return layer


def _opened(identifier: str, resolved: str, file: str) -> Sdf.Layer | None:
    """Return the layer of an identifier; None where that is left to the reader of USD."""
    if layer := Sdf.Layer.Find(identifier):
        return layer
    if layer := read_text(resolved):
        return layer
    try:
        with uncut(file):
            return Sdf.Layer.FindOrOpen(identifier)
    except DAMAGE:
        return None


def _decoded(path: str, data: bytes) -> str:
    """Return the text of a layer. Raises StageError that tells where it is no UTF-8."""
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise StageError(
            f"{path}: line {line} is not UTF-8 (byte 0x{data[error.start]:02x}), the only encoding "
            "of a text layer; save it as UTF-8"
        ) from None
