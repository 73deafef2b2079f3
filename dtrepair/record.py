"""The JSON report of a run: dataclasses, schema `dtrepair.report/1`, checked and atomic writing.

Counts follow the definition of the whole package: pairs of triangles that share no vertex (vertices
at one float32 position count as one) and have a common point, in float32 coordinates.
Displacements are relative to the bounding-box diagonal. Times are time codes; `null` is the default
time of USD, or a mesh file, which has no time.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from dtrepair.atomic_files import write_atomically

SCHEMA_NAME = "dtrepair.report/1"
STATUSES = ("clean", "improved", "unchanged", "failed", "skipped")
_COUNTED = ("clean", "improved", "unchanged")


@dataclass(frozen=True, kw_only=True)
class CountRecord:
    """Intersecting triangles, intersecting pairs, and the pairs between different objects."""

    triangles: int = 0
    pairs: int = 0
    inter_pairs: int = 0


@dataclass(frozen=True, kw_only=True)
class PrimRecord:
    """One mesh of the run; `rest_intersections` counts triangles, None where not measured."""

    path: str
    vertices: int
    triangles: int
    rest_intersections: int | None = None


@dataclass(frozen=True, kw_only=True)
class FramePrimRecord:
    """Counts of one mesh in one frame."""

    path: str
    before: CountRecord | None
    after: CountRecord | None


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
    """One frame: what was found, what was done, what is left. Counts are None where it failed."""

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
    stages: tuple[StageRecord, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Report:
    """A whole run; `document()` is what is written."""

    command: str
    version: str
    input: str
    output: str | None = None
    device: str = "cpu"
    settings: Mapping[str, Any] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    prims: tuple[PrimRecord, ...] = ()
    frames: tuple[FrameRecord, ...] = ()
    warnings: tuple[str, ...] = ()
    jitter: float | None = None
    transfer: Mapping[str, Any] | None = None

    def document(self) -> dict[str, Any]:
        """Return the report as plain JSON values, checked against `SCHEMA`.

        Raises ReportError where a value does not fit (an unknown status, a negative count, NaN).
        """
        content = {
            "schema": SCHEMA_NAME,
            "version": self.version,
            "command": self.command,
            "input": self.input,
            "output": self.output,
            "device": self.device,
            "settings": dict(self.settings),
            "seconds": dict(self.seconds),
            "warnings": list(self.warnings),
            "prims": [asdict(prim) for prim in self.prims],
            "frames": [asdict(frame) for frame in self.frames],
            "summary": summarize(self.frames, jitter=self.jitter),
        }
        if self.transfer is not None:
            content["transfer"] = dict(self.transfer)
        try:
            document: dict[str, Any] = json.loads(json.dumps(content, allow_nan=False))
        except (TypeError, ValueError) as error:
            raise ReportError(
                f"report: expected finite plain values, got otherwise: {error}"
            ) from None
        validate(document)
        return document


class ReportError(ValueError):
    """A report that does not follow the schema."""


def summarize(frames: Iterable[FrameRecord], *, jitter: float | None = None) -> dict[str, Any]:
    """Return the totals over all frames. Frames without counts (failed ones) add nothing."""
    frames = tuple(frames)
    summary: dict[str, Any] = {"frames": len(frames)}
    for status in STATUSES:
        summary[status] = sum(frame.status == status for frame in frames)
    for when in ("before", "after"):
        counts = [getattr(frame, when) for frame in frames]
        for name in ("triangles", "pairs", "inter_pairs"):
            summary[f"{name}_{when}"] = sum(getattr(c, name) for c in counts if c is not None)
    moved = [frame for frame in frames if frame.status in _COUNTED]
    summary["displacement_max"] = max((frame.displacement_max for frame in moved), default=0.0)
    summary["displacement_mean"] = (
        sum(frame.displacement_mean for frame in moved) / len(moved) if moved else 0.0
    )
    summary["jitter"] = jitter
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
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ReportError(f"{path}: expected a JSON report, got: {error}") from None
    try:
        validate(document)
    except ReportError as error:
        raise ReportError(f"{path}: {error}") from None
    return dict(document)


def validate(document: object) -> None:
    """Check a document against `SCHEMA`. Raises ReportError that names the place."""
    _check(document, SCHEMA, "report")


def _object(*optional: str, **properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": [name for name in properties if name not in optional],
        "additionalProperties": False,
    }


_TEXT = {"type": "string"}
_COUNT = {"type": "integer", "minimum": 0}
_AMOUNT = {"type": "number", "minimum": 0}
_COUNTS = {
    **_object(triangles=_COUNT, pairs=_COUNT, inter_pairs=_COUNT),
    "type": ["object", "null"],
}
_FRAME = _object(
    time={"type": ["number", "null"]},
    status={"type": "string", "enum": list(STATUSES)},
    message=_TEXT,
    before=_COUNTS,
    after=_COUNTS,
    iterations=_COUNT,
    seconds=_AMOUNT,
    displacement_max=_AMOUNT,
    displacement_mean=_AMOUNT,
    prims={"type": "array", "items": _object(path=_TEXT, before=_COUNTS, after=_COUNTS)},
    stages={
        "type": "array",
        "items": _object(
            name=_TEXT,
            crossings=_COUNT,
            folds=_COUNT,
            distortion=_AMOUNT,
            iterations=_COUNT,
            seconds=_AMOUNT,
        ),
    },
)
_SUMMARY = _object(
    frames=_COUNT,
    **{status: _COUNT for status in STATUSES},
    **{
        f"{name}_{when}": _COUNT
        for when in ("before", "after")
        for name in ("triangles", "pairs", "inter_pairs")
    },
    displacement_max=_AMOUNT,
    displacement_mean=_AMOUNT,
    jitter={"type": ["number", "null"], "minimum": 0},
)
_FIGURE = {"type": ["number", "null"], "minimum": 0}
# Only of transfers. Residuals have no unit; parts are of the target's triangles or area; None
# where no frame could be measured, or without markers.
_TRANSFER = _object(
    correspondence={"type": "string", "enum": ["topology", "markers", "file"]},
    target=_TEXT,
    pairs=_COUNT,
    unmatched=_COUNT,
    unmatched_area=_AMOUNT,
    largest_hole=_COUNT,
    source_used=_AMOUNT,
    root_scale=_AMOUNT,
    residual_median=_FIGURE,
    residual_p95=_FIGURE,
    residual_max=_FIGURE,
    inside_out=_FIGURE,
    unit_ratio=_FIGURE,
    turn_degrees=_FIGURE,
    rest_error=_FIGURE,
    markers={
        **_object(
            count=_COUNT,
            distance_median=_AMOUNT,
            distance_max=_AMOUNT,
            suspects={"type": "array", "items": _COUNT},
            swapped={"type": "array", "items": {"type": "array", "items": _COUNT}},
        ),
        "type": ["object", "null"],
    },
)
SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": SCHEMA_NAME,
    **_object(
        "transfer",
        schema={"type": "string", "enum": [SCHEMA_NAME]},
        version=_TEXT,
        command=_TEXT,
        input=_TEXT,
        output={"type": ["string", "null"]},
        device=_TEXT,
        settings={"type": "object"},
        seconds={"type": "object", "additionalProperties": _AMOUNT},
        warnings={"type": "array", "items": _TEXT},
        prims={
            "type": "array",
            "items": _object(
                path=_TEXT,
                vertices=_COUNT,
                triangles=_COUNT,
                rest_intersections={"type": ["integer", "null"], "minimum": 0},
            ),
        },
        frames={"type": "array", "items": _FRAME},
        summary=_SUMMARY,
        transfer=_TRANSFER,
    ),
}


def _type_name(value: object) -> str:
    # bool is an int in Python, but not an integer in JSON.
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, float) and not math.isfinite(value):
        return "non-finite number"
    names = {dict: "object", list: "array", str: "string", int: "integer", float: "number"}
    return names.get(type(value), "null" if value is None else type(value).__name__)


def _check(value: Any, schema: Mapping[str, Any], place: str) -> None:
    """Check the part of JSON Schema that `SCHEMA` uses, which avoids a dependency."""
    kind = _type_name(value)
    allowed = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if kind not in allowed and not (kind == "integer" and "number" in allowed):
        raise ReportError(f"{place}: expected {' or '.join(allowed)}, got {kind}")
    if "enum" in schema and value not in schema["enum"]:
        raise ReportError(f"{place}: expected one of {', '.join(schema['enum'])}, got {value!r}")
    if "minimum" in schema and value is not None and value < schema["minimum"]:
        raise ReportError(f"{place}: expected at least {schema['minimum']}, got {value}")
    if kind == "object":
        _check_object(value, schema, place)
    elif kind == "array":
        for index, item in enumerate(value):
            _check(item, schema["items"], f"{place}[{index}]")


def _check_object(value: Mapping[str, Any], schema: Mapping[str, Any], place: str) -> None:
    properties = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            raise ReportError(f"{place}: expected the property {name!r}, got none")
    extra = schema.get("additionalProperties", True)
    for name, item in value.items():
        if name in properties:
            _check(item, properties[name], f"{place}.{name}")
        elif extra is False:
            raise ReportError(f"{place}: got the unknown property {name!r}")
        elif extra is not True:
            _check(item, extra, f"{place}.{name}")
