"""Configs, reports and correspondence files of random damage."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dtrepair.transfer import read_correspondence, write_correspondence
from tests.command_line import CLOSED, OPEN, run, tube_obj, tube_stage
from tests.fuzz.damage import REAL, VALUE, WHOLE, WORD, damaged, ends_well, fuzzed, replaced
from tests.meshes import icosphere

FACES = icosphere(0)[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("settings")
    tube_obj(path / "mesh.obj", OPEN)
    return path


KEYS = [
    "mode",
    "jobs",
    "device",
    "ignore",
    "attach",
    "prim",
    "frames",
    "rest-contacts",
    "check",
    "a",
]
TABLE_KEYS = [
    "path",
    "diffusion",
    "mobility",
    "rigid",
    "pin",
    "direction",
    "attach",
    "detach",
    "layer",
    "a",
]
TOML = st.one_of(
    WHOLE.map(str),
    REAL.map(str),
    WORD.map(lambda word: json.dumps(word)),
    st.sampled_from(
        ["true", "nan", "-inf", "1979-05-27", "[]", "[[]]", "{}", "{a = 1}", "'''", "9" * 5000]
    ),
    st.sampled_from(["[1, 'a']", '"self"', '"cpu"', "[" * 3000, "{a." * 100]),
)


@fuzzed
@given(
    top=st.lists(st.tuples(st.sampled_from(KEYS), TOML), max_size=2),
    own=st.lists(st.tuples(st.sampled_from(KEYS), TOML), max_size=2),
    table=st.lists(st.tuples(st.sampled_from(TABLE_KEYS), TOML), max_size=3),
)
def test_configs(
    folder: Path,
    top: list[tuple[str, str]],
    own: list[tuple[str, str]],
    table: list[tuple[str, str]],
) -> None:
    lines = [f"{key} = {value}" for key, value in top]
    lines += ["[check]", *(f"{key} = {value}" for key, value in own)]
    lines += ["[[prim]]", *(f"{key} = {value}" for key, value in table)]
    path = folder / "config.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    ends_well("check", folder / "mesh.obj", "--config", path)


@fuzzed
@given(damaged(b'mode = "self"\n[check]\njobs = 1\n[[prim]]\npath = "/A"\nlayer = 2\n'))
def test_bytes_of_configs(folder: Path, data: bytes) -> None:
    path = folder / "bytes.toml"
    path.write_bytes(data)
    ends_well("check", folder / "mesh.obj", "--config", path)


def test_reports(folder: Path) -> None:
    stage = tube_stage(folder / "in.usda", (OPEN, CLOSED))
    assert run("check", stage, "--json", folder / "good.json").code == 1
    good = json.loads((folder / "good.json").read_text())
    path = folder / "report.json"

    @fuzzed
    @given(replaced(good))
    def values(document: Any) -> None:
        path.write_text(json.dumps(document))
        ends_well("report", path, "-o", folder / "page.html", "--pictures", "0", codes=(0, 3))

    @fuzzed
    @given(damaged(json.dumps(good).encode()))
    def bytes_of_text(data: bytes) -> None:
        path.write_bytes(data)
        ends_well("report", path, "-o", folder / "page.html", "--pictures", "0", codes=(0, 3))

    values()
    bytes_of_text()


def correspondence(path: Path) -> None:
    """Read a correspondence, or be told in one line that it is none."""
    try:
        pairs = read_correspondence(path, FACES, FACES)
    except ValueError as error:
        assert str(error).startswith(f"{path}")
    else:
        assert pairs.ndim == 2 and pairs.min() >= 0 and pairs.max() < len(FACES)


@fuzzed
@given(st.data())
def test_bytes_of_correspondences(folder: Path, data: st.DataObject) -> None:
    name = data.draw(st.sampled_from(["bytes.npz", "bytes.txt", "bytes.tricorrs"]))
    path = folder / name
    write_correspondence(path, np.array([[0, 1], [2, 3]]), FACES, FACES)
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    correspondence(path)


ARRAY = st.one_of(
    VALUE.filter(lambda value: value is not None and not isinstance(value, dict | list)),
    st.lists(WHOLE.filter(lambda value: abs(value) < 2**62), max_size=4),
    st.lists(st.tuples(REAL, REAL), max_size=3),
)


@fuzzed
@given(
    entries=st.dictionaries(st.sampled_from(["format", "pairs", "counts", "hashes", "x"]), ARRAY),
    good=st.booleans(),
)
@example(entries={"counts": 3, "hashes": [1, 2], "pairs": [[0, 0]]}, good=True)
def test_entries_of_correspondences(folder: Path, entries: dict[str, Any], good: bool) -> None:
    path = folder / "entries.npz"
    more: dict[str, Any] = {"format": "dtrepair.correspondence/1"} if good else {}
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in (more | entries).items()}
    plain = {name: array for name, array in arrays.items() if array.dtype != object}
    np.savez_compressed(path, allow_pickle=False, **plain)
    correspondence(path)
