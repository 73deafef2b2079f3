"""Layers of frame ranges, such as those of a farm, as one layer."""

from __future__ import annotations

import os
from collections.abc import Sequence

from dtrepair.pipeline.errors import plain_errors
from dtrepair.pipeline.stages.outputs import FilePath


def join_layers(layers: Sequence[FilePath], output: FilePath) -> None:
    """Merge layers that chunks or frame ranges of one input were written to into one layer.

    Stacking them would show one of them only: the strongest layer with any time sample owns the
    whole attribute.

    Args:
        layers: paths, in any order.
        output: path of the layer; it appears whole at the end, or not at all.

    Raises:
        PipelineError: with the exit code that stands for it, see its subclasses.
    """
    import usd_io

    with plain_errors():
        usd_io.join_layers([os.fspath(layer) for layer in layers], os.fspath(output))
