"""Every field of a report is explained, and the page that explains them is up to date."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from docs.making import report_page
from docs.making.report_page import page, schema_at, title_of
from dtrepair.report.fields import SECTIONS
from dtrepair.report.schema import SCHEMA, validate

PAGE = Path(__file__).parents[2] / "docs" / "report.md"


def objects(schema: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """Every object of the schema with fields of its own."""
    if "properties" in schema:
        yield schema
    items = [schema["items"]] if "items" in schema else []
    for inner in (*schema.get("properties", {}).values(), *items):
        yield from objects(inner)


@pytest.mark.parametrize("title", SECTIONS)
def test_a_section_explains_the_fields_that_there_are(title: str) -> None:
    place, what, fields = SECTIONS[title]
    assert list(fields) == list(schema_at(place)["properties"])
    assert all(words.endswith(".") for words in (what, *fields.values()))


def test_every_object_has_a_section() -> None:
    assert {title_of(found) for found in objects(SCHEMA)} == set(SECTIONS)


def test_the_page_is_up_to_date(monkeypatch: pytest.MonkeyPatch) -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text == page(), "run python -m docs.making.report_page"
    anchors = {title.lower().replace(" ", "-") for title in SECTIONS}
    assert set(re.findall(r"\]\(#([\w-]+)\)", text)) <= anchors
    place, what, fields = SECTIONS["Mesh"]
    changed = {**SECTIONS, "Mesh": (place, what, {**fields, "path": "Elsewhere."})}
    monkeypatch.setattr(report_page, "SECTIONS", changed)
    assert page() != text


def test_the_example_is_a_report() -> None:
    (text,) = re.findall(r"```json\n(.*?)\n```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    example = json.loads(text)
    validate(example)
    (frame,) = example["frames"]
    assert frame["prims"][0]["size"] > 0 and example["summary"]["triangles_before"] > 0
