"""Writes docs/report.md, what each field of a report means, from the schema and its words.

python -m docs.making.report_page
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dtrepair.report.fields import SECTIONS
from dtrepair.report.schema import SCHEMA, SCHEMA_NAME

PAGE = Path(__file__).parents[1] / "report.md"
EXAMPLE = Path(__file__).parent / "report_example.json"
INTRODUCTION = f"""# The JSON report

`--report report.json` writes what was found and done, frame by frame, in the format
`{SCHEMA_NAME}`. `dtrepair report` makes a page of it, and
`dtrepair.report.record.SCHEMA` is its JSON Schema. A field that may be missing is there only where
there is something to tell. This page is made from the schema by
`python -m docs.making.report_page`.
"""
_TYPES = {
    "string": "text",
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "object": "object",
}


def schema_at(place: str) -> Mapping[str, Any]:
    """The part of the schema at a place such as `frames[].before`."""
    found: Mapping[str, Any] = SCHEMA
    for name in filter(None, place.split(".")):
        found = found["properties"][name.removesuffix("[]")]
        found = found["items"] if name.endswith("[]") else found
    return found


def title_of(schema: Mapping[str, Any]) -> str | None:
    """The title of the section about an object; None for other values."""
    if "properties" not in schema:
        return None
    return next(title for title, (place, _, _) in SECTIONS.items() if schema == schema_at(place))


def words_of(schema: Mapping[str, Any]) -> str:
    """What kind of value it is, with a link to the section about it."""
    every = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    kind = next(kind for kind in every if kind != "null")
    if kind == "array":
        words = f"list of {words_of(schema['items'])}"
    elif title := title_of(schema):
        words = f"[{title}](#{title.lower().replace(' ', '-')})"
    else:
        words = _TYPES[kind]
    return f"{words} or null" if "null" in every else words


def page() -> str:
    """The text of the page."""
    lines = [INTRODUCTION]
    for title, (place, what, fields) in SECTIONS.items():
        schema = schema_at(place)
        where = f"`{place}`: " if place else ""
        lines += [
            f"## {title}\n",
            f"{where}{what}\n",
            "| field | value | meaning |",
            "|---|---|---|",
        ]
        for name, own in schema["properties"].items():
            kind = words_of(own)
            kind += "" if name in schema["required"] else "; may be missing"
            lines.append(f"| `{name}` | {kind} | {fields[name]} |")
        lines.append("")
    example = EXAMPLE.read_text(encoding="utf-8").rstrip()
    lines += ["## An example\n", "One frame of a bent tube whose ends went through each other:\n"]
    return "\n".join([*lines, f"```json\n{example}\n```"]) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
