"""Layers of frame ranges, such as those of a farm, as one layer."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import fields

from dtrepair.pipeline.errors import UsageError, plain_errors
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.outputs import FilePath, is_readable


def join_layers(layers: Sequence[FilePath], output: FilePath) -> None:
    """Merge layers that chunks or frame ranges of one input were written to into one layer.

    Stacking them would show one of them only: the strongest layer with any time sample owns the
    whole attribute. Layers that were written with other settings, by another version, or over
    another content of the input are refused.

    Args:
        layers: paths, in any order.
        output: path of the layer; it appears whole at the end, or not at all.

    Raises:
        PipelineError: with the exit code that stands for it, see its subclasses.
    """
    import usd_io

    with plain_errors():
        usd_io.join_layers(_paths(layers), os.fspath(output), differing=_chosen())


def check_joined(layers: Sequence[FilePath], output: FilePath) -> None:
    """Refuse an output that was joined of other layers, and layers that cannot be joined.

    An output that is not there, or cannot be read, is none, and nothing is looked at.

    Raises:
        PipelineError: as `join_layers` does; UsageError for an output of other layers.
    """
    import usd_io

    if not is_readable(output):
        return
    with plain_errors():
        joined = usd_io.is_joined(_paths(layers), os.fspath(output), differing=_chosen())
    if not joined:
        raise UsageError(
            f"{output}: exists, and was joined of other layers; name another output, or remove it"
        )


def _paths(layers: Sequence[FilePath]) -> list[str]:
    return [os.fspath(layer) for layer in layers]


def _chosen() -> list[str]:
    """What was chosen of an input, which may differ, and so do the settings of single objects."""
    return [*(field.name for field in fields(Selection)), "objects"]
