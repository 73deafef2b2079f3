"""Props: meshes that only a transform moves, beside a body that bends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dtrepair.pipeline.selection import ObjectSettings
from dtrepair.pipeline.stages.shot.furniture import FurnitureOptions, is_body, poses_of
from dtrepair.pipeline.stages.sources import Source, SourceMesh, StageSource, few_times


def find_props(
    source: Source,
    each: Sequence[ObjectSettings],
    *,
    options: FurnitureOptions = FurnitureOptions(),
) -> None:
    """Mark the meshes that are props; by what is seen at three times of the whole clip.

    each: the settings of each mesh; one that is told how stiff it is, is none.
    """
    if not isinstance(source, StageSource) or len(source.meshes) < 2:
        return
    both = zip(source.meshes, each, strict=True)
    carried = [_is_carried(mesh) and _nobody_says(own) for mesh, own in both]
    if not any(carried):
        return
    times = few_times(source)
    others = (mesh for mesh in source.meshes if mesh.animated and not _is_carried(mesh))
    if any(is_body(mesh, poses_of(source, mesh, times), options) for mesh in others):
        source.meshes = tuple(
            replace(mesh, prop=own) for mesh, own in zip(source.meshes, carried, strict=True)
        )


def _is_carried(mesh: SourceMesh) -> bool:
    """Return whether a mesh moves, but keeps its points."""
    if not mesh.animated or mesh.collider:
        return False
    return not mesh.handle.skinned and len(mesh.handle.times) <= 1


def _nobody_says(own: ObjectSettings) -> bool:
    return own.rigid is None and own.diffusion is None
