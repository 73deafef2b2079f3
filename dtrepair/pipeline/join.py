"""Layers of frame ranges, such as those of a farm, as one layer."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import fields

from dtrepair.pipeline.errors import plain_errors
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.outputs import FilePath


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
        # What was chosen of an input may differ, and so do the settings of single objects.
        chosen = [*(field.name for field in fields(Selection)), "objects"]
        usd_io.join_layers(
            [os.fspath(layer) for layer in layers], os.fspath(output), differing=chosen
        )
