"""What `dtrepair transfer` says: its plan, each frame, its table and figures."""

from __future__ import annotations

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.repair_text import clearance_line, planned_line
from dtrepair.cli.terminal.strain_text import strain_lines
from dtrepair.pipeline.observer import FrameDone
from dtrepair.pipeline.stages.plan import Plan
from dtrepair.pipeline.stages.sources import time_label
from dtrepair.report.record import Report
from dtrepair.wording import counted


def print_plan(console: Console, plan: Plan) -> None:
    """Print what a run would do."""
    rows = [[mesh.path, str(mesh.vertices), str(mesh.triangles), mesh.rest] for mesh in plan.meshes]
    console.table(["mesh", "vertices", "triangles", "rest pose"], rows)
    console.result(planned_line(plan))


def say(console: Console, done: FrameDone) -> None:
    """Say how a frame went: with -v, or where it failed."""
    record = done.record
    label = f"frame {time_label(record.time)}"
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
    faces = sum(prim.triangles for prim in report.prims)
    console.result(
        f"{section.pairs} pairs of triangles ({section.correspondence}); "
        f"{section.unmatched} of {faces} target triangles unmatched"
    )
    if section.residual_median is not None:
        console.result(
            f"residual: median {section.residual_median:.3f}, 95 % below {section.residual_p95:.3f}"
        )
    known = [(record, record.after) for record in report.frames if record.after is not None]
    clean = sum(not c.pairs and record.status != "strained" for record, c in known)
    left = sum(c.triangles for _, c in known)
    console.result(
        f"{clean} of {counted(len(report.frames), 'frame')} clean; {left} intersecting triangles"
        + ("" if repaired or not left else ": --repair removes them")
    )
    for line in (clearance_line(report.frames), *strain_lines(report.frames)):
        if line:
            console.result(line)
    console.result(f"written: {report.output}")
