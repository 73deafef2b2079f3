"""The JSON report of a run: dataclasses, schema `dtrepair.report/1`, checked and atomic writing.

Counts follow the definition of the whole package: pairs of triangles that share no vertex (vertices
at one float32 position count as one) and have a common point, in float32 coordinates.
Displacements are relative to the bounding-box diagonal, which frames tell as `size`. Times are time
codes; `null` is the default time of USD, or a mesh file, which has no time.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dtrepair.diagnosis import CountRecord as CountRecord
from dtrepair.diagnosis import Diagnosis
from dtrepair.files.atomic import write_atomically
from dtrepair.report.findings import MotionFinding
from dtrepair.report.parts import (
    AttachedList,
    PartPairs,
    PassingRecord,
    WornRecord,
    over_frames,
)
from dtrepair.report.schema import SCHEMA as SCHEMA
from dtrepair.report.schema import SCHEMA_NAME, STATUSES, ReportError, validate
from dtrepair.report.sections import KeyposesRecord, TransferRecord

_COUNTED = ("clean", "strained", "improved", "unchanged")


@dataclass(frozen=True, kw_only=True)
class PrimRecord:
    """One mesh of the run; `rest_intersections` counts triangles, None where not measured."""

    path: str
    vertices: int
    triangles: int
    rest_intersections: int | None = None


@dataclass(frozen=True, kw_only=True)
class MotionRecord:
    """How far a repair moved one of several meshes, and what it did to its shape.

    displacement_max, and rigid_rms of the best rigid motion, relative to the mesh's own diagonal;
    edge_distortion is the rms log-ratio of edge lengths to the rest, edge_change that to the input.
    """

    displacement_max: float
    rigid_rms: float
    edge_distortion: float
    edge_change: float


@dataclass(frozen=True)
class FramePrimRecord:
    """Counts of one mesh in one frame, and of several meshes how each moved: None if not.

    size: the diagonal of its bounding box before the repair, stage units, of which displacements
    are fractions; None where nothing was to move.
    """

    path: str
    before: CountRecord | None
    after: CountRecord | None
    motion: MotionRecord | None = None
    size: float | None = None


@dataclass(frozen=True)
class ContactRecord:
    """Intersecting pairs of triangles of two meshes, or of one with itself: first is second."""

    first: str
    second: str
    before: int
    after: int


@dataclass(frozen=True, kw_only=True)
class EnclosedRecord:
    """So many parts of one mesh lie wholly inside another, or inside other parts of the same."""

    inner: str
    outer: str
    parts: int


@dataclass(frozen=True)
class StageRecord:
    """A stage of the repair of one frame: pairs left after it, distortion reached, cost."""

    name: str
    crossings: int
    folds: int
    distortion: float
    iterations: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class FrameRecord:
    """One frame: what was found, what was done, what is left. Counts are None where it failed.

    enclosed: None where nobody looked. modelled: modelled contacts by pairs of parts.
    faults: contacts that count, by pairs of parts, where there are several.
    left: what a repair left, of all objects.
    geodesic: the largest distance along a mesh between two of its triangles that still intersect,
    of the mesh's largest coordinate range: small where only creases are left. normal_consistency:
    mean cosine between normals of triangles before and after. Both None where nothing was repaired.
    """

    time: float | None
    status: str
    message: str = ""
    before: CountRecord | None = None
    after: CountRecord | None = None
    iterations: int = 0
    seconds: float = 0.0
    displacement_max: float = 0.0
    displacement_mean: float = 0.0
    prims: tuple[FramePrimRecord, ...] = ()
    contacts: tuple[ContactRecord, ...] = ()
    enclosed: tuple[EnclosedRecord, ...] | None = None
    stages: tuple[StageRecord, ...] = ()
    modelled: PartPairs = field(default_factory=PartPairs)
    faults: PartPairs = field(default_factory=PartPairs)
    left: Diagnosis = field(default_factory=Diagnosis)
    geodesic: float | None = None
    normal_consistency: float | None = None

    def document(self) -> dict[str, Any]:
        """Return the frame as plain values; lists of parts and what is left where there are any."""
        content = asdict(self)
        for prim in content["prims"]:
            if prim["size"] is None:
                del prim["size"]
        for name in ("modelled", "faults", "left"):
            if not getattr(self, name):
                del content[name]
        for name in ("geodesic", "normal_consistency"):
            if content[name] is None:
                del content[name]
        return content


@dataclass(frozen=True, kw_only=True)
class Report:
    """A whole run; `document()` is what is written.

    folder: where the run stood: what `input` and `output` are relative to.
    attached: the pairs of connected parts whose contacts are modelled.
    passing: parts that meet in the bind pose and are not taken for attached.
    worn: the connected parts that are taken as worn, where anybody looked.
    findings: what a clean repair may still be looked at for.
    alone_from: first frame from which a repair could not go on with frames together.
    """

    command: str
    version: str
    input: str
    output: str | None = None
    folder: str = field(default_factory=os.getcwd)
    device: str = "cpu"
    settings: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    prims: tuple[PrimRecord, ...] = ()
    frames: tuple[FrameRecord, ...] = ()
    warnings: tuple[str, ...] = ()
    jitter: float | None = None
    attached: AttachedList = field(default_factory=AttachedList)
    passing: tuple[PassingRecord, ...] = ()
    worn: tuple[WornRecord, ...] = ()
    findings: tuple[MotionFinding, ...] = ()
    alone_from: float | None = None
    transfer: TransferRecord | None = None
    keyposes: KeyposesRecord | None = None

    def document(self) -> dict[str, Any]:
        """Return the report as plain JSON values, checked against `SCHEMA`.

        Raises ReportError where a value does not fit (an unknown status, a negative count, NaN).
        """
        content: dict[str, Any] = {
            "schema": SCHEMA_NAME,
            "version": self.version,
            "command": self.command,
            "input": self.input,
            "output": self.output,
            "folder": self.folder,
            "device": self.device,
            "settings": dict(self.settings),
            "seconds": dict(self.seconds),
            "warnings": list(self.warnings),
            "prims": [asdict(prim) for prim in self.prims],
            "frames": [frame.document() for frame in self.frames],
            "summary": summarize(self.frames, jitter=self.jitter),
        }
        # Not in `summarize`: outputs hold that, and stay the same to the byte.
        if close := sum(frame.left.too_close > 0 for frame in self.frames):
            content["summary"]["too_close"] = close
        for name, section in (("transfer", self.transfer), ("keyposes", self.keyposes)):
            if section is not None:
                content[name] = asdict(section)
        if self.attached:
            content["attached"] = asdict(self.attached)
        for name in ("passing", "worn"):
            if records := getattr(self, name):
                content[name] = [asdict(record) for record in records]
        if self.findings:
            content["findings"] = [found.document() for found in self.findings]
        if self.alone_from is not None:
            content["alone_from"] = self.alone_from
        try:
            document: dict[str, Any] = json.loads(json.dumps(content, allow_nan=False))
        except (TypeError, ValueError) as error:
            raise ReportError(
                f"report: expected finite plain values, got otherwise: {error}"
            ) from None
        validate(document)
        return document


def summarize(frames: Iterable[FrameRecord], *, jitter: float | None = None) -> dict[str, Any]:
    """Return the totals over all frames. Frames without counts (failed ones) add nothing."""
    frames = tuple(frames)
    summary: dict[str, Any] = {"frames": len(frames)}
    for status in STATUSES:
        summary[status] = sum(frame.status == status for frame in frames)
    for when in ("before", "after"):
        counts = [getattr(frame, when) for frame in frames]
        for name in ("triangles", "pairs", "inter_pairs", "modelled_triangles", "modelled_pairs"):
            summary[f"{name}_{when}"] = sum(getattr(c, name) for c in counts if c is not None)
    moved = [frame for frame in frames if frame.status in _COUNTED]
    summary["displacement_max"] = max((frame.displacement_max for frame in moved), default=0.0)
    summary["displacement_mean"] = (
        sum(frame.displacement_mean for frame in moved) / len(moved) if moved else 0.0
    )
    summary["jitter"] = jitter
    met: dict[tuple[str, str], list[int]] = {}
    for contact in (contact for frame in frames for contact in frame.contacts):
        counts = met.setdefault((contact.first, contact.second), [0, 0])
        counts[0] += contact.before
        counts[1] += contact.after
    summary["contacts"] = [
        {"first": first, "second": second, "before": before, "after": after}
        for (first, second), (before, after) in sorted(met.items())
    ]
    for name in ("modelled", "faults"):
        if found := over_frames(getattr(frame, name) for frame in frames):
            summary[name] = asdict(found)
    return summary


def write_report(report: Report, path: str | os.PathLike[str]) -> None:
    """Write the checked report as JSON, whole or not at all. Raises ReportError, OSError."""
    write_atomically(path, render_report(report))


def render_report(report: Report) -> str:
    """Return the checked report as indented JSON text with a final newline."""
    return json.dumps(report.document(), indent=1, allow_nan=False) + "\n"


def read_report(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a report and check it. Raises ReportError (not JSON, or not this schema), OSError."""
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:  # also of bytes that are no text, and of numbers without end
        raise ReportError(f"{path}: expected a JSON report, got: {error}") from None
    except RecursionError:
        raise ReportError(f"{path}: expected a JSON report, got one nested too deeply") from None
    try:
        validate(document)
    except ReportError as error:
        raise ReportError(f"{path}: {error}") from None
    return dict(document)
