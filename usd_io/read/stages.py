"""Opening a stage with readable errors, and nothing printed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pxr import Sdf, Usd

from usd_io.diagnostics import DAMAGE, no_diagnostics
from usd_io.errors import StageError, UsageError, one_line
from usd_io.layers import file_size, find_layers
from usd_io.paths import same_file

# Extensions of usd-core; plugins may add more, so this is only used for a better message.
USD_EXTENSIONS = (".usd", ".usda", ".usdc", ".usdz")


@dataclass(frozen=True)
class OpenedStage:
    """A stage, kept alive, with the warnings of opening it.

    Attributes:
        stage: the composed stage.
        path: the path it was opened from.
        warnings: composition errors and unloaded payloads, one line each.
        sizes: number on its disk and bytes of each file of the stage, before it was opened.
        clips: layers of value clips, which the stage finds while they are held.
    """

    stage: Usd.Stage
    path: str
    warnings: tuple[str, ...]
    sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    clips: Sequence[Sdf.Layer | None] = ()

    def check_unchanged(self) -> None:
        """Raise StageError if a file of the stage has another size than when it was opened.

        Binary layers are read bit by bit as they are needed: what came after that is no frame of
        either file. A file that another one replaced is read on as it was.
        """
        for file, (inode, size) in self.sizes.items():
            now = file_size(file)
            if now is not None and now[0] == inode and now[1] != size:
                raise StageError(
                    f"{file}: was changed while it was read, from {size} to {now[1]} bytes; wait "
                    "until it is written, and run again"
                )


def open_stage(
    path: str | os.PathLike[str], *, load_payloads: bool = True, strict: bool = False
) -> OpenedStage:
    """Open a stage.

    Args:
        path: a usd, usda, usdc or usdz file.
        load_payloads: load all payloads; otherwise meshes behind them are not seen, with a warning.
        strict: broken references, sublayers and the like are an error instead of a warning.

    Raises:
        StageError: the file is missing, empty, not USD, damaged, or (strict) not whole.
    """
    path = os.fspath(path)
    _check_file(path)
    load = Usd.Stage.LoadAll if load_payloads else Usd.Stage.LoadNone
    try:
        with no_diagnostics():
            layers = find_layers(path, payloads=load_payloads)
            stage = Usd.Stage.Open(path, load)
            broken = [one_line_of(str(error)) for error in stage.GetCompositionErrors()]
    except DAMAGE as error:
        raise StageError(
            f"{path}: cannot be opened as USD ({one_line(error)}); export it again"
        ) from None
    if broken and strict:
        many = f"{len(broken)} composition errors, first" if broken[1:] else "composition error"
        raise StageError(f"{path}: {many}: {broken[0]}; mend the reference or leave out strict")
    warnings = [f"{path}: {text}" for text in broken]
    unloaded = len(set(stage.FindLoadable()) - set(stage.GetLoadSet())) if not load_payloads else 0
    if unloaded:
        warnings.append(f"{path}: {unloaded} payloads are not loaded; their meshes are not seen")
    files = {layer.realPath.partition("[")[0] for layer in stage.GetUsedLayers()} | {*layers.clips}
    sizes = {file: layers.sizes.get(file) or file_size(file) for file in sorted(files) if file}
    known = {file: size for file, size in sizes.items() if size is not None}
    return OpenedStage(stage, path, tuple(warnings), known, tuple(layers.clips.values()))


def as_stage(stage: OpenedStage | Usd.Stage) -> Usd.Stage:
    """Return the `Usd.Stage` of an opened stage, or the stage itself."""
    return stage.stage if isinstance(stage, OpenedStage) else stage


def check_not_an_input(stage: Usd.Stage, path: str) -> None:
    """Raise UsageError if a path is a file the stage is made of, or refers to."""
    for layer in stage.GetUsedLayers(True):
        files = [layer.realPath.partition("[")[0]]
        # Also files that are missing or not loaded now: writing them would close a circle.
        for asset in layer.GetCompositionAssetDependencies():
            files.append(layer.ComputeAbsolutePath(asset))
        for file in files:
            if file and same_file(file, path):
                raise UsageError(
                    f"{path}: is part of the input stage; choose another output, it will be a "
                    "layer over the input"
                )


def one_line_of(text: str) -> str:
    """Return a text of several lines as one line."""
    return " ".join(text.split())


def _check_file(path: str) -> None:
    """Raise StageError for a path that is no file that can be read."""
    if not path:
        raise StageError("no stage given: the path is empty")
    # A path into a package (scene.usdz[shot.usda]) is left to pxr.
    if path.endswith("]"):
        return
    if not os.path.exists(path):
        raise StageError(f"{path}: no such file; check the path")
    if os.path.isdir(path):
        raise StageError(f"{path}: is a directory; name a file in it")
    if not os.access(path, os.R_OK):
        raise StageError(f"{path}: cannot be read: no permission; let it be readable to you")
    if os.path.getsize(path) == 0:
        raise StageError(f"{path}: the file is empty (0 bytes); export it again")
    if not path.lower().endswith(USD_EXTENSIONS):
        # Other extensions may still have a plugin; pxr decides, this only helps its message.
        if Sdf.FileFormat.FindByExtension(path) is None:
            raise StageError(f"{path}: not a USD file; expected one of {', '.join(USD_EXTENSIONS)}")


def input_digest(stage: OpenedStage | Usd.Stage) -> str:
    """Return a digest of the content of the layer files of a stage, wherever they lie.

    Layers that are no files of their own, such as those in memory, do not count.
    """
    layers = as_stage(stage).GetUsedLayers()
    files = {layer.realPath.partition("[")[0] for layer in layers} - {""}
    if isinstance(stage, OpenedStage):
        files |= set(stage.sizes)  # also value clips that were not needed yet
    digest = hashlib.sha256()
    for content in sorted(_content(file) for file in files):
        digest.update(content)
    return digest.hexdigest()


def _content(file: str) -> bytes:
    try:
        with open(file, "rb") as stream:
            return hashlib.file_digest(stream, "sha256").digest()
    except OSError:
        return b""
