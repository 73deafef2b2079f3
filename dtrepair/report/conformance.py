"""Values against a JSON Schema: the part of it that reports use, without a dependency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

# Beyond, numbers of JSON are not the same in every program.
LARGEST_COUNT = 2**53


class ReportError(ValueError):
    """A report that does not follow the schema."""


def _type_name(value: object) -> str:
    # bool is an int in Python, but not an integer in JSON.
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, float) and not math.isfinite(value):
        return "non-finite number"
    names = {dict: "object", list: "array", str: "string", int: "integer", float: "number"}
    return names.get(type(value), "null" if value is None else type(value).__name__)


def check_value(value: Any, schema: Mapping[str, Any], place: str) -> None:
    """Check a value at a place against a schema. Raises ReportError that names the place."""
    kind = _type_name(value)
    allowed = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    if kind not in allowed and not (kind == "integer" and "number" in allowed):
        raise ReportError(f"{place}: expected {' or '.join(allowed)}, got {kind}")
    if "enum" in schema and value not in schema["enum"]:
        raise ReportError(f"{place}: expected one of {', '.join(schema['enum'])}, got {value!r}")
    if "minimum" in schema and value is not None and value < schema["minimum"]:
        raise ReportError(f"{place}: expected at least {schema['minimum']}, got {value}")
    if kind == "integer" and abs(value) > LARGEST_COUNT:
        raise ReportError(f"{place}: expected at most {LARGEST_COUNT}, got a larger number")
    if kind == "object":
        _check_object(value, schema, place)
    elif kind == "array":
        for index, item in enumerate(value):
            check_value(item, schema["items"], f"{place}[{index}]")


def _check_object(value: Mapping[str, Any], schema: Mapping[str, Any], place: str) -> None:
    properties = schema.get("properties", {})
    for name in schema.get("required", ()):
        if name not in value:
            raise ReportError(f"{place}: expected the property {name!r}, got none")
    extra = schema.get("additionalProperties", True)
    for name, item in value.items():
        if name in properties:
            check_value(item, properties[name], f"{place}.{name}")
        elif extra is False:
            raise ReportError(f"{place}: got the unknown property {name!r}")
        elif extra is not True:
            check_value(item, extra, f"{place}.{name}")
