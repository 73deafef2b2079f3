"""What a transfer says: its section of the report, its table, its picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.cli.terminal.console import Console
from dtrepair.pipeline.repair.solve import Repaired
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.pipeline.transfer.correspondence import Correspondence, Mesh
from dtrepair.pipeline.transfer.solve import FrameTransfer
from dtrepair.report.record import Report

_FIGURES = (
    "residual_median",
    "residual_p95",
    "residual_max",
    "inside_out",
    "unit_ratio",
    "turn_degrees",
    "rest_error",
)
# What the library calls its arguments, and what the command line calls them.
_OPTIONS = (
    ("give the rotation between them", "--align rests turns the motion with them"),
    ("add markers there", "add --markers there"),
)


def describe(
    found: Correspondence, moves: FrameTransfer, meshes: tuple[Mesh, Mesh], target: str
) -> tuple[dict[str, Any], list[str]]:
    """The report's section `transfer`, and warnings."""
    from dtrepair.transfer import measure_coverage

    coverage = measure_coverage(found.pairs, meshes[0][1], *meshes[1])
    figures = moves.figures() or {}
    section = {
        "correspondence": found.origin,
        "target": target,
        "pairs": coverage.pairs,
        "unmatched": coverage.unmatched,
        "unmatched_area": coverage.unmatched_area,
        "largest_hole": coverage.largest_hole,
        "source_used": coverage.source_used,
        "root_scale": float(moves.transfer.placement.ratio),
        **{name: figures.get(name) for name in _FIGURES},
        "markers": found.markers,
    }
    warnings = list(figures.get("warnings", coverage.warnings))
    for words, option in _OPTIONS:
        warnings = [text.replace(words, option) for text in warnings]
    return section, warnings


def say(console: Console, done: Repaired) -> None:
    """Say how a frame went: with -v, or where it failed."""
    record = done.record
    label = f"frame {time_label(record.time)}"
    console.trace(done.error)
    if record.before is None or record.after is None:
        console.warn([f"{label}: {record.status}: {record.message}"])
        return
    if record.status == "failed":
        console.warn([f"{label}: not repaired: {record.message}"])
    change = f"{record.before.triangles} -> {record.after.triangles}"
    console.remark(f"{label}: {change} intersecting triangles, {record.status}")


def print_report(console: Console, report: Report, *, repaired: bool) -> None:
    """Print one row for each frame that intersects itself, and what the transfer is worth."""
    rows = []
    for record in report.frames:
        label = time_label(record.time)
        if record.before is None or record.after is None:
            rows.append([label, "", *([""] if repaired else []), record.status])
        elif record.before.pairs:
            counts = [record.before, *([record.after] if repaired else [])]
            rows.append([label, *(str(count.triangles) for count in counts), record.status])
    if rows:
        header = ["frame", "transferred", *(["repaired"] if repaired else []), "status"]
        if not repaired:
            header, rows = header[:2], [row[:2] for row in rows]
        console.table(header, rows)
    assert report.transfer is not None
    section = report.transfer
    faces = report.prims[0].triangles
    console.result(
        f"{section['pairs']} pairs of triangles ({section['correspondence']}); "
        f"{section['unmatched']} of {faces} target triangles unmatched"
    )
    if section["residual_median"] is not None:
        console.result(
            f"residual: median {section['residual_median']:.3f}, "
            f"95 % below {section['residual_p95']:.3f}"
        )
    after = [record.after for record in report.frames if record.after is not None]
    clean, left = sum(c.pairs == 0 for c in after), sum(c.triangles for c in after)
    console.result(
        f"{clean} of {len(report.frames)} frames clean; {left} intersecting triangles"
        + ("" if repaired or not left else ": --repair removes them")
    )
    console.result(f"written: {report.output}")


def draw_registration(
    path: str, source: Mesh, target: Mesh, found: Correspondence, *, up: NDArray[np.float64]
) -> None:
    """Draw the registered source, the target with its unmatched triangles, and both together.

    Without a registration the source's rest is laid over the target by its triangle pairs.
    """
    from dtrepair.display.render import make_view, render, save_pictures
    from dtrepair.transfer.rests import laid_over

    placed = found.registered
    if placed is None:
        placed = laid_over(source, target, found.pairs)
    unmatched = np.ones(len(target[1]), dtype=bool)
    unmatched[found.pairs[:, 1]] = False
    view = make_view([placed, target[0]], up=up)
    together = np.concatenate([target[0], placed])
    faces = np.concatenate([target[1], source[1] + len(target[0])]).astype(np.int32)
    red = np.arange(len(faces)) >= len(target[1])
    images = [
        render(placed, source[1], view=view),
        render(target[0], target[1], view=view, intersecting=unmatched),
        render(together, faces, view=view, intersecting=red),
    ]
    captions = [
        "source, registered" if found.registered is not None else "source, laid over",
        f"target: {int(unmatched.sum())} unmatched triangles",
        "both: source in red",
    ]
    save_pictures(path, images, captions=captions)
