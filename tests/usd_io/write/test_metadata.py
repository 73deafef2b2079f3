from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt

from tests.usd_stages import cube_file
from usd_io.write.metadata import copy_stage_metadata, get_record, set_record, usd_dictionary


@pytest.mark.parametrize("extension", ["usda", "usdc"])
def test_a_record_survives_the_file(tmp_path: Path, extension: str) -> None:
    record = {
        "none": None,
        "flag": True,
        "count": np.int64(7),
        "large": 2**40,
        "ratio": np.float32(0.5),
        "text": "a/b: 'c'",
        "path": Path("x/y"),
        "flags": [True, False],
        "counts": (1, 2),
        "times": [1.0, 2.5],
        "mixed": [1, 2.5],
        "names": ["b", "a"],
        "set": {"b", "a"},
        "empty": [],
        "array": np.arange(4).reshape(2, 2),
        "/Root/Cube": {"deep": {"deeper": [1]}},
    }
    layer = Sdf.Layer.CreateNew(str(tmp_path / f"a.{extension}"))
    layer.customLayerData = {"other": "kept"}
    set_record(layer, record)
    layer.Save()
    del layer
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / f"a.{extension}"))
    assert layer.customLayerData["other"] == "kept"
    found = get_record(layer)
    assert "none" not in found and found["flag"] is True
    assert (found["count"], found["large"], found["ratio"]) == (7, 2**40, 0.5)
    assert (found["text"], found["path"]) == ("a/b: 'c'", "x/y")
    lists = {key: list(found[key]) for key in ("flags", "counts", "times", "mixed", "names", "set")}
    assert lists == {
        "flags": [True, False],
        "counts": [1, 2],
        "times": [1.0, 2.5],
        "mixed": [1.0, 2.5],
        "names": ["b", "a"],
        "set": ["a", "b"],
    }
    assert list(found["empty"]) == [] and list(found["array"]) == [0, 1, 2, 3]
    assert list(found["/Root/Cube"]["deep"]["deeper"]) == [1]


def test_layers_without_a_record() -> None:
    layer = Sdf.Layer.CreateAnonymous()
    assert get_record(layer) == {}
    layer.customLayerData = {"dtrepair": "not ours"}
    assert get_record(layer) == {}


@pytest.mark.parametrize("extension", ["usda", "usdc"])
def test_a_record_that_a_layer_gave_is_stored_as_it_was(tmp_path: Path, extension: str) -> None:
    given: dict[str, Any] = {
        "ignore": [],
        "counts": [1, 2],
        "flags": [True],
        "times": [0.5],
        "names": ["a"],
    }
    for name in ("first", "second"):
        layer = Sdf.Layer.CreateNew(str(tmp_path / f"{name}.{extension}"))
        set_record(layer, {"settings": given})
        layer.Save()
        given = get_record(layer)["settings"]
    assert {key: list(value) for key, value in given.items()} == {
        "ignore": [],
        "counts": [1, 2],
        "flags": [True],
        "times": [0.5],
        "names": ["a"],
    }


def test_dictionaries_in_a_list_are_json() -> None:
    contacts = [{"first": "/A'b", "before": 3, "after": None}, {}]
    stored = usd_dictionary({"contacts": contacts})["contacts"]
    assert [json.loads(text) for text in stored] == contacts


def test_an_empty_array_of_numbers_keeps_its_type() -> None:
    assert isinstance(usd_dictionary({"frames": np.zeros(0)})["frames"], Vt.DoubleArray)


def test_unknown_values_become_text() -> None:
    assert usd_dictionary({"a": 1j, "b": [1j, None]}) == {"a": "1j", "b": ["1j", "None"]}


def test_asset_valued_metadata_is_seen_from_the_output(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda")
    layer = Sdf.Layer.FindOrOpen(str(path))
    layer.colorConfiguration = Sdf.AssetPath("./colours/config.ocio")
    layer.Save()
    output = Sdf.Layer.CreateAnonymous()
    copy_stage_metadata(Usd.Stage.Open(str(path)), output, str(tmp_path / "fixed"))
    assert output.colorConfiguration.path == "../colours/config.ocio"
