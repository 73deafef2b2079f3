"""Layers to join whose record or samples are damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pxr import Sdf

from tests.usd_io.read.test_damaged import with_count
from tests.usd_io.write.test_joining import chunk
from tests.usd_stages import cube_file, moved_cube
from usd_io import StageError, join_layers, open_stage
from usd_io.write.records import check_alike, check_record, part_of, repaired_stage

GOOD = {"settings": {"chunk": "1/2"}, "frames": [1.0], "written": {"/A": [1.0]}}


def test_parts_are_numbers_of_a_split() -> None:
    assert part_of("2/10") == (2, 10)
    wrong = ["", "0/2", "3/2", "x/2", "1/", "1/2/3", "-1/2", "1/99999999999", "\u0661/2", None, 3]
    assert not any(part_of(text) for text in wrong)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("settings", None),
        ("settings", "text"),
        ("settings", {"chunk": "one/two"}),
        ("settings", {"chunk": 5}),
        ("written", None),
        ("written", [1.0]),
        ("written", {"/A": None}),
        ("written", {"/A": ["x"]}),
        ("frames", None),
        ("frames", [float("nan")]),
        ("written_default", None),
        ("written_default", "/A"),
        ("written_default", [1.0]),
    ],
)
def test_an_entry_of_a_wrong_type_is_named(name: str, value: Any) -> None:
    check_record("a.usdc", GOOD)
    with pytest.raises(StageError, match=rf"^a\.usdc: entry '{name}.*' of its record is damaged"):
        check_record("a.usdc", {**GOOD, name: value})


def layer_over(path: Path, below: list[str], settings: Any) -> Path:
    """A layer over others, with a record of some settings."""
    layer = Sdf.Layer.CreateNew(str(path))
    layer.subLayerPaths = below
    layer.customLayerData = {"dtrepair": {"settings": settings}}
    layer.Save()
    return path


def test_a_repaired_stage_is_known_by_its_record(tmp_path: Path) -> None:
    path, repair = cube_file(tmp_path / "in.usda"), {"rest_contacts": "auto"}
    once = layer_over(tmp_path / "once.usda", ["./in.usda"], repair)
    twice = layer_over(tmp_path / "twice.usda", ["./once.usda"], repair)
    others = [
        layer_over(tmp_path / "moved.usda", ["./in.usda"], {**repair, "source_path": "walk.usd"}),
        layer_over(tmp_path / "two.usda", ["./once.usda", "./in.usda"], repair),
        layer_over(tmp_path / "none.usda", ["./in.usda"], {}),
        layer_over(tmp_path / "text.usda", ["./in.usda"], "rest_contacts"),
        path,
    ]
    assert [repaired_stage(open_stage(layer)) for layer in (once, twice)] == 2 * [str(path)]
    assert not any(repaired_stage(open_stage(layer)) for layer in others)


def test_a_layer_below_itself_is_followed_once(tmp_path: Path) -> None:
    path = layer_over(tmp_path / "a.usda", ["./a.usda"], {"rest_contacts": "auto"})
    assert repaired_stage(open_stage(path)) == str(path)


def test_a_record_that_another_program_changed_is_refused(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=[1.0, 2.0])
    parts = [chunk(path, tmp_path / f"{time:.0f}.usda", [time]) for time in (1.0, 2.0)]
    layer = Sdf.Layer.FindOrOpen(str(parts[1]))
    record = layer.customLayerData["dtrepair"]
    layer.customLayerData = {"dtrepair": {**record, "frames": "none"}}
    layer.Save()
    with pytest.raises(StageError, match=r"2\.usda: entry 'frames' of its record is damaged"):
        join_layers(parts, tmp_path / "out.usdc")
    assert not (tmp_path / "out.usdc").exists()


def test_a_sample_that_cannot_be_read_names_layer_and_attribute(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usdc", times=[1.0, 2.0])
    parts = [chunk(path, tmp_path / f"{k}.usdc", [float(k)], change=0.0) for k in (1, 2)]
    with_count(parts[1], moved_cube(2.0).tobytes(), 100)
    with pytest.raises(StageError, match=r"2\.usdc: /Root/Cube\.points: cannot be read \("):
        join_layers(parts, tmp_path / "out.usdc")
    assert not (tmp_path / "out.usdc").exists()


@pytest.mark.parametrize(
    ("entries", "words"),
    [
        ({"settings": {"chunk": "2/2"}, "input_digest": "f00d"}, "the content of the input"),
        ({"settings": {}, "input_digest": "beef"}, "that only one is a chunk"),
    ],
)
def test_what_two_layers_differ_in_is_named(entries: dict[str, Any], words: str) -> None:
    part = {"settings": {"chunk": "1/2"}, "input_digest": "beef"}
    with pytest.raises(StageError, match=rf"differ in {words}; write them again"):
        check_alike("a.usdc", part, "b.usdc", entries, ())
    # Whole layers of other versions say nothing of the content.
    check_alike("a.usdc", {"settings": {}, "input_digest": "beef"}, "b.usdc", {"settings": {}}, ())
