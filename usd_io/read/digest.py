"""A digest of all files of a stage, by which two machines know that they have the same input."""

from __future__ import annotations

import hashlib

from pxr import Usd

from usd_io.read.stages import OpenedStage, as_stage


def input_digest(stage: OpenedStage | Usd.Stage) -> str:
    """Return a digest of the content of the layer files of a stage, wherever they lie.

    Layers that are no files of their own, such as those in memory, do not count.
    """
    layers = as_stage(stage).GetUsedLayers()
    files = {layer.realPath.partition("[")[0] for layer in layers} - {""}
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
