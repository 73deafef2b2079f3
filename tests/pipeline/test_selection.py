"""Selections, and tables of settings of single meshes, which are checked once for all hosts."""

from __future__ import annotations

import pytest

from dtrepair.pipeline import CheckSettings, ObjectSettings, PrimTable, Selection, UsageError
from dtrepair.pipeline.selection import object_of, parse_layer, parse_tables, refuse_unknown


def test_tables_become_settings() -> None:
    tables = [{"path": "/World/Sword", "diffusion": 9, "rigid": True}, {"path": "/World"}]
    assert parse_tables(tables, "c.toml") == (
        PrimTable(
            "/World/Sword",
            ObjectSettings(diffusion=9.0, rigid=True),
            "c.toml: [[prim]] /World/Sword",
        ),
        PrimTable("/World", ObjectSettings(), "c.toml: [[prim]] /World"),
    )
    assert parse_tables(tables[1], "c.toml")[0].path == "/World"


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "needs a path"),
        ("/World", "needs a path"),
        ({"path": "/A", "speed": 1}, "has no 'speed'; known are diffusion, mobility"),
        ({"path": "/A", "mobility": 2}, "mobility should be from 0 to 1, got 2"),
        ({"path": "/A", "mobility": True}, "mobility should be a number"),
        ({"path": "/A", "diffusion": 0}, "diffusion should be positive and finite"),
        ({"path": "/A", "rigid": 1}, "rigid should be true or false"),
        ({"path": "/A", "pin": 3}, "pin should be a name"),
        ({"path": "/A", "layer": 1.5}, "layer should be a whole number or a primvar, got 1.5"),
        ({"path": "/A", "layer": True}, "layer should be a whole number"),
        ({"path": "/A", "layer": 2**31}, "layer should be a whole number"),
        ({"path": "/A", "attach": ["/B", ""]}, "attach should be path expressions"),
        ({"path": "/A", "attach": 1}, "attach should be path expressions"),
    ],
)
def test_wrong_tables_are_refused(table: object, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        parse_tables([table], "c.toml")


def test_layers_and_attachments_are_taken_as_they_are_written() -> None:
    tables = [{"path": "/A", "layer": 2, "attach": "/B"}, {"path": "/A", "attach": ["/B", "/C//"]}]
    first, second = parse_tables(tables, "c.toml")
    assert first.settings == ObjectSettings(layer=2, attach=("/B",))
    assert second.settings == ObjectSettings(attach=("/B", "/C//"))
    assert parse_layer("//Coat{isa:Mesh} = -2") == ("//Coat{isa:Mesh}", -2)


@pytest.mark.parametrize("text", ["/Coat", "=2", "/Coat=", "/Coat=1.5", "/Coat=--1"])
def test_wrong_layers_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="expected a prim and a whole number"):
        parse_layer(text)


def test_references_alone_may_be_strict() -> None:
    chosen = Selection(strict_references=True)
    assert chosen.recorded["strict_references"] and chosen.given() == ["--strict-references"]
    assert object_of(Selection, chosen.recorded) == chosen
    assert CheckSettings(selection=chosen).counting == "auto"
    assert CheckSettings(selection=Selection(strict=True)).counting == "repair"
    assert "strict_references" not in Selection(strict=True).recorded


def test_objects_of_recorded_values() -> None:
    values = {"frames": "1:3", "strict": True, "other": 1}
    assert object_of(Selection, values) == Selection(frames="1:3", strict=True)
    refuse_unknown(values, [Selection], ["other"])
    with pytest.raises(UsageError, match="nothing here is called 'other'"):
        refuse_unknown(values, [Selection])
