"""Source and target of a transfer, opened: their rest poses and axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dtrepair.pipeline.stages.rest import Rest, choose_rests
from dtrepair.pipeline.stages.sources import MeshSource, Source, StageSource
from dtrepair.pipeline.transfer.inputs import (
    Axes,
    compare_axes,
    input_problems,
    open_poses,
    open_target,
)
from dtrepair.pipeline.transfer.settings import TransferSettings
from dtrepair.pipeline.transfer.shapes import open_shapes


@dataclass(frozen=True)
class Pair:
    """Both inputs with their rest poses and axes; what should be known of them."""

    source: Source
    target: StageSource | MeshSource
    source_rest: Rest
    target_rest: Rest
    axes: Axes
    warnings: tuple[str, ...]

    @property
    def meshes(self) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Rest points and faces of source and target."""
        return (
            (self.source_rest.points, self.source.meshes[0].faces),
            (self.target_rest.points, self.target.meshes[0].faces),
        )


def open_pair(source_path: str, target_path: str, settings: TransferSettings, device: str) -> Pair:
    """Open both inputs and choose their rest poses."""
    options = settings.options
    open_source = open_shapes if options.shapes else open_poses
    source = open_source(source_path, settings.poses, settings.selection)
    target = open_target(target_path, options.target_prim)
    warnings = [*source.warnings, *target.warnings, *input_problems(source, target)]
    rest = settings.rest
    if rest is None and source.name != source_path:
        rest = source_path  # the poses are a stage of their own, the source its rest
    axes = compare_axes(source, target, (options.source_up, options.target_up))
    source_rest = choose_rests(source, rest, device=device)[0]
    target_rest = choose_rests(target, None, device=device)[0]
    for side, found in ((source, source_rest), (target, target_rest)):
        if found.of_frame:
            warnings.append(
                f"{side.name}: {side.meshes[0].path} has no points at the default time; its rest "
                f"pose is taken from {found.origin}"
            )
    return Pair(source, target, source_rest, target_rest, axes, tuple(warnings))
