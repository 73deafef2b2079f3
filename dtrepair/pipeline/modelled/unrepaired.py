"""The stage below a repaired layer, which still tells what moves what."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dtrepair.pipeline.errors import PipelineError
from dtrepair.pipeline.stages.sources import Source, StageSource


def unrepaired(source: Source) -> Source:
    """Return the stage that a stage is a repair of, with the same meshes; any other one itself.

    A layer with repaired points unbinds what a skeleton moves, and gives time samples to what only
    transforms move: it no longer shows which parts were modelled together.
    """
    import usd_io

    if type(source) is not StageSource or not (path := usd_io.repaired_stage(source.opened)):
        return source
    try:
        found = source.like(path)
    except (PipelineError, usd_io.UsdIoError):
        return source
    return found if _alike(found, source) else source


def repaired_otherwise(source: Source, counting: str, given: Mapping[str, Sequence[str]]) -> str:
    """Return the options of a repair that tell what counts, and that nobody has given again.

    counting: how rest contacts count in this run; given: the pairs of each option of it, by its
    name. "" where none are missing, and for what is no repair.
    """
    import usd_io

    if type(source) is not StageSource:
        return ""
    settings = usd_io.repair_settings(source.opened)
    missing = [
        f'--{name} "{text}"'
        for name, own in given.items()
        for text in settings.get(name, ())
        if text not in own
    ]
    if settings.get("rest_contacts") == "repair" != counting:
        missing.append("--rest-contacts repair")
    return " ".join(missing)


def _alike(first: StageSource, second: StageSource) -> bool:
    """Return whether two stages have the same meshes, in one space."""
    return (
        [mesh.path for mesh in first.meshes] == [mesh.path for mesh in second.meshes]
        and np.array_equal(first.origin, second.origin)
        and all(
            a.rest.shape == b.rest.shape and np.array_equal(a.faces, b.faces)
            for a, b in zip(first.meshes, second.meshes, strict=True)
        )
    )
