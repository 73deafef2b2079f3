"""What a report says of a transfer: coverage, residuals, markers; and what is wrong with it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from dtrepair.pipeline.transfer.correspondence import Correspondence
from dtrepair.pipeline.transfer.pair import Mesh
from dtrepair.report.sections import TransferRecord

if TYPE_CHECKING:
    from dtrepair.pipeline.transfer.solve import FrameTransfer


def describe(
    found: Correspondence, moves: FrameTransfer, meshes: tuple[Mesh, Mesh], target: str
) -> tuple[TransferRecord, tuple[str, ...]]:
    """Return the section `transfer` of a report, and warnings.

    Figures are None without a usable frame."""
    from dtrepair.transfer import measure_coverage
    from dtrepair.transfer.report import REMEDIES, Concern

    # What the library calls its arguments, hosts know by the names of the options.
    remedies = {
        **REMEDIES,
        Concern.UNMATCHED: "add --markers there",
        Concern.TURN: "--align rests turns the motion with them",
    }
    figures = moves.examined()
    coverage = measure_coverage(found.pairs, meshes[0][1], *meshes[1])
    section = TransferRecord(
        correspondence=found.origin,
        target=target,
        pairs=coverage.pairs,
        unmatched=coverage.unmatched,
        unmatched_area=coverage.unmatched_area,
        largest_hole=coverage.largest_hole,
        source_used=coverage.source_used,
        root_scale=float(moves.transfer.placement.ratio),
        markers=found.markers,
    )
    if figures is None:
        return section, coverage.sentences(remedies)
    section = replace(
        section,
        residual_median=figures.residual_median,
        residual_p95=figures.residual_p95,
        residual_max=figures.residual_max,
        inside_out=figures.flipped,
        unit_ratio=figures.unit_ratio,
        turn_degrees=figures.turn,
        rest_error=figures.rest_error,
    )
    return section, figures.sentences(remedies)
