"""The schema `dtrepair.report/1` of JSON reports, and the check of a document against it."""

from __future__ import annotations

from typing import Any

from dtrepair.diagnosis import Advice, Status, StrainKind
from dtrepair.keyposes.options import INTERPOLATIONS
from dtrepair.report.conformance import ReportError as ReportError
from dtrepair.report.conformance import check_value
from dtrepair.report.findings import FindingKind

SCHEMA_NAME = "dtrepair.report/1"
STATUSES = tuple(str(status) for status in Status)


def validate(document: object) -> None:
    """Check a document against `SCHEMA`. Raises ReportError that names the place."""
    check_value(document, SCHEMA, "report")


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
# Counts of what was modelled, which the others leave out; older reports have none of them.
_MODELLED = ("modelled_triangles", "modelled_pairs")
_COUNTS = {
    **_object(
        *_MODELLED,
        triangles=_COUNT,
        pairs=_COUNT,
        inter_pairs=_COUNT,
        **{name: _COUNT for name in _MODELLED},
    ),
    "type": ["object", "null"],
}
# Of several meshes how each was moved; None for those that were not.
_MOTION = {
    **_object(
        displacement_max=_AMOUNT, rigid_rms=_AMOUNT, edge_distortion=_AMOUNT, edge_change=_AMOUNT
    ),
    "type": ["object", "null"],
}
# Pairs of triangles of two meshes that intersect, and (first is second) of one with itself.
_CONTACT = _object(first=_TEXT, second=_TEXT, before=_COUNT, after=_COUNT)
# Connected parts wholly inside closed ones, which intersect nothing; None where nobody looked.
_ENCLOSED = _object(inner=_TEXT, outer=_TEXT, parts=_COUNT)
# A measure of a part of an object beyond its bound, worst at `place` of the input, in the space
# that counts: the vertex and the part, from 1, are numbers within the object. Lengths are fractions
# of the diagonal, volumes of that of the part or piece.
_STRAIN = _object(
    "size",
    "other",
    body=_TEXT,
    part=_COUNT,
    parts=_COUNT,
    kind={"type": "string", "enum": [str(kind) for kind in StrainKind]},
    value=_AMOUNT,
    bound=_AMOUNT,
    vertex=_COUNT,
    place={"type": "array", "items": {"type": "number"}},
    size={"type": ["number", "null"], "minimum": 0},
    other={"type": ["string", "null"]},
)
# What a repair left of all objects, and what may be done about it: see `dtrepair.diagnosis`.
_LEFT = _object(
    "strains",
    contacts={
        "type": "array",
        "items": _object(
            first=_TEXT, second=_TEXT, pairs=_COUNT, held=_COUNT, rigid={"type": "boolean"}
        ),
    },
    advice={"type": "array", "items": {"type": "string", "enum": [str(item) for item in Advice]}},
    rest_pairs=_COUNT,
    enclosures={"type": "array", "items": _object(inner=_TEXT, outer=_TEXT)},
    too_close=_COUNT,
    deformations={
        "type": "array",
        "items": _object(body=_TEXT, lengths=_AMOUNT, volume={"type": ["number", "null"]}),
    },
    strains={"type": "array", "items": _STRAIN},
)
_POINT = {"type": "array", "items": {"type": "number"}}
# A connected part of a mesh, and contacts by pairs of parts: `dtrepair.report.parts`.
_PART = _object(
    path=_TEXT,
    number={"type": ["integer", "null"], "minimum": 1},
    triangles=_COUNT,
    centre=_POINT,
)
_PAIR_COUNTS = _object(
    **{f"{name}_{when}": _COUNT for name in ("pairs", "triangles") for when in ("before", "after")}
)
_PART_PAIRS = _object(
    listed={
        "type": "array",
        "items": _object(first=_PART, second=_PART, counts=_PAIR_COUNTS, centre=_POINT),
    },
    others=_object(parts=_COUNT, counts=_PAIR_COUNTS),
)
_ATTACHED = _object(
    listed={
        "type": "array",
        "items": _object(first=_PART, second=_PART, pairs=_COUNT, pose=_TEXT, centre=_POINT),
    },
    others=_COUNT,
    other_pairs=_COUNT,
)
# What is taken as worn: one connected part over another.
_WORN = _object(over=_PART, under=_PART)
# What a clean repair may still be looked at for: see `dtrepair.report.findings`.
_FINDING = _object(
    kind={"type": "string", "enum": [str(kind) for kind in FindingKind]},
    path=_TEXT,
    largest=_AMOUNT,
    times={"type": "array", "items": {"type": "number"}},
)
_FRAME = _object(
    "contacts",
    "enclosed",
    "modelled",
    "faults",
    "left",
    "geodesic",
    "normal_consistency",
    time={"type": ["number", "null"]},
    status={"type": "string", "enum": list(STATUSES)},
    message=_TEXT,
    before=_COUNTS,
    after=_COUNTS,
    iterations=_COUNT,
    seconds=_AMOUNT,
    displacement_max=_AMOUNT,
    displacement_mean=_AMOUNT,
    geodesic=_AMOUNT,
    normal_consistency={"type": "number"},
    prims={
        "type": "array",
        "items": _object(
            "motion",
            "size",
            path=_TEXT,
            before=_COUNTS,
            after=_COUNTS,
            motion=_MOTION,
            size=_AMOUNT,
        ),
    },
    contacts={"type": "array", "items": _CONTACT},
    modelled=_PART_PAIRS,
    faults=_PART_PAIRS,
    left=_LEFT,
    enclosed={"type": ["array", "null"], "items": _ENCLOSED},
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
    "contacts",
    "modelled",
    "faults",
    "too_close",
    str(Status.STRAINED),
    *(f"{name}_{when}" for when in ("before", "after") for name in _MODELLED),
    frames=_COUNT,
    **{status: _COUNT for status in STATUSES},
    **{
        f"{name}_{when}": _COUNT
        for when in ("before", "after")
        for name in ("triangles", "pairs", "inter_pairs", *_MODELLED)
    },
    displacement_max=_AMOUNT,
    displacement_mean=_AMOUNT,
    jitter={"type": ["number", "null"], "minimum": 0},
    contacts={"type": "array", "items": _CONTACT},
    modelled=_PART_PAIRS,
    faults=_PART_PAIRS,
    too_close=_COUNT,
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
_SAMPLES = _object(samples=_COUNT, dirty=_COUNT, pairs=_COUNT)
# Only of key poses: samples between two keys, those that intersect, and their pairs; `left` are
# the times of those that still do, `added` those of added keys.
_KEYPOSES = _object(
    interpolation={"type": "string", "enum": list(INTERPOLATIONS)},
    skipped=_COUNT,
    spans={
        "type": "array",
        "items": _object(
            start={"type": "number"},
            end={"type": "number"},
            before=_SAMPLES,
            after=_SAMPLES,
            left={"type": "array", "items": {"type": "number"}},
            added={"type": "array", "items": {"type": "number"}},
        ),
    },
)
SCHEMA: dict[str, Any] = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": SCHEMA_NAME,
    **_object(
        "folder",
        "attached",
        "passing",
        "worn",
        "findings",
        "alone_from",
        "transfer",
        "keyposes",
        schema={"type": "string", "enum": [SCHEMA_NAME]},
        version=_TEXT,
        command=_TEXT,
        input=_TEXT,
        output={"type": ["string", "null"]},
        folder=_TEXT,
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
        attached=_ATTACHED,
        passing={"type": "array", "items": _object(first=_PART, second=_PART)},
        worn={"type": "array", "items": _WORN},
        findings={"type": "array", "items": _FINDING},
        alone_from={"type": "number"},
        transfer=_TRANSFER,
        keyposes=_KEYPOSES,
    ),
}
