"""Stages and layers to join, with hostile values and of random damage.

Bytes of binary stages are damaged where values are, and cut; not in the tables at their end: what
those announce, pxr makes room for before it looks.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pxr import Sdf

from tests.command_line import run
from tests.fuzz.damage import REAL, VALUE, damaged, ends_well, fuzzed
from tests.usd_io.read.test_damaged import with_count
from tests.usd_stages import cube_file, define_cube, moved_cube, new_stage, vec3f
from usd_io.write.metadata import usd_dictionary

_NUMBERS = count()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("stages")


@contextmanager
def new(folder: Path, extension: str) -> Iterator[Path]:
    """A path that was not there before: pxr keeps layers by their paths."""
    path = folder / f"{next(_NUMBERS)}.{extension}"
    yield path
    path.unlink()


NUMBER = st.one_of(REAL.map(repr), st.sampled_from(["nan", "inf", "-inf", "2", "-1"]))
INDEX = st.sampled_from(["0", "1", "2", "3", "-1", "7", "2147483647", "-2147483648"])
TRIPLE = st.tuples(NUMBER, NUMBER, NUMBER).map(lambda row: f"({', '.join(row)})")


def row(item: st.SearchStrategy[str], most: int = 6) -> st.SearchStrategy[str]:
    """A list of values as a text layer has it."""
    return st.lists(item, max_size=most).map(lambda items: f"[{', '.join(items)}]")


SAMPLES = st.lists(st.tuples(NUMBER, row(TRIPLE) | st.just("None")), max_size=3).map(
    lambda items: "{" + ", ".join(f"{time}: {value}" for time, value in items) + "}"
)
# Properties of the second mesh, which may stand in for the good ones.
PROPERTY = st.one_of(
    row(TRIPLE).map(lambda text: f"point3f[] points = {text}"),
    SAMPLES.map(lambda text: f"point3f[] points.timeSamples = {text}"),
    row(INDEX).map(lambda text: f"int[] faceVertexCounts = {text}"),
    row(INDEX).map(lambda text: f"int[] faceVertexIndices = {text}"),
    row(INDEX).map(lambda text: f"int[] holeIndices = {text}"),
    TRIPLE.map(lambda text: f"double3 xformOp:translate = {text}"),
    TRIPLE.map(lambda text: f"float3 xformOp:scale = {text}"),
    st.sampled_from(
        [
            'string[] points = ["a"]',
            "int points = 3",
            "float[] points = [1, 2, 3]",
            "double[] faceVertexCounts = [3]",
            'token visibility = "invisible"',
            "int visibility = 1",
            'uniform token orientation = "leftHanded"',
            'uniform token subdivisionScheme = "no\x1b[31m"',
            "string xformOp:scale = 'x'",
            'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]',
            'uniform token[] xformOpOrder = ["xformOp:gone"]',
            'uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:scale"]',
            "rel skel:skeleton = </Gone>",
            "custom double dtrepair:diffusion = -1",
            'custom string dtrepair:attach = "///"',
        ]
    ),
)
META = st.one_of(
    st.tuples(
        st.sampled_from(["metersPerUnit", "timeCodesPerSecond", "startTimeCode"]), NUMBER
    ).map(lambda pair: f"{pair[0]} = {pair[1]}"),
    st.sampled_from(['upAxis = "Q"', "subLayers = [@./gone.usda@]", 'defaultPrim = "Gone"']),
)
GOOD = {
    "points": "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]",
    "faceVertexCounts": "int[] faceVertexCounts = [3, 3, 3, 3]",
    "faceVertexIndices": "int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]",
}


def mesh(name: str, properties: list[str]) -> list[str]:
    """A mesh prim: each property once, and good ones where nothing stands in for them."""
    given_names = {
        line.split(" = ")[0].split()[-1].removesuffix(".timeSamples"): line for line in properties
    }
    lines = {**GOOD, **given_names}
    return [f'def Mesh "{name}" {{', *lines.values(), "}"]


@fuzzed
@given(properties=st.lists(PROPERTY, max_size=4), meta=st.lists(META, max_size=2))
@example(properties=["point3f[] points = []"], meta=[])
@example(properties=["int points = 3"], meta=[])
@example(properties=["point3f[] points.timeSamples = {nan: [(0, 0, 0)]}"], meta=[])
@example(
    properties=[
        "double3 xformOp:translate = (1e300, 0, 0)",
        'uniform token[] xformOpOrder = ["xformOp:translate"]',
    ],
    meta=["metersPerUnit = nan"],
)
def test_text_stages(folder: Path, properties: list[str], meta: list[str]) -> None:
    lines = ["#usda 1.0", "(", *{line.split()[0]: line for line in meta}.values(), ")"]
    lines += [*mesh("A", []), *mesh("B", properties)]
    with new(folder, "usda") as path:
        path.write_text("\n".join(lines))
        ends_well("check", path)


def test_bytes_of_text_stages(folder: Path) -> None:
    good = cube_file(folder / "good.usda", times=[1.0, 2.0]).read_bytes()

    @fuzzed
    @given(damaged(good))
    def holds(data: bytes) -> None:
        with new(folder, "usda") as path:
            path.write_bytes(data)
            ends_well("check", path)

    holds()


@fuzzed
@given(cut=st.integers(0, 2000), number=st.sampled_from([0, 7, 9, 100, 2**16, 2**63, 2**64 - 1]))
@example(cut=2000, number=100)
def test_binary_stages_that_are_cut_or_count_wrongly(folder: Path, cut: int, number: int) -> None:
    with new(folder, "usdc") as path:
        with_count(cube_file(path, times=[1.0, 2.0]), moved_cube(2.0).tobytes(), number)
        path.write_bytes(path.read_bytes()[:cut])
        ends_well("check", path)


POSES = st.lists(st.lists(REAL | st.just(np.nan), min_size=24, max_size=24), min_size=1, max_size=3)


@fuzzed
@given(POSES)
def test_binary_stages_of_any_coordinates(folder: Path, poses: list[list[float]]) -> None:
    with new(folder, "usdc") as path, np.errstate(over="ignore"):
        stage = new_stage(path)
        attribute = define_cube(stage, points=None).CreatePointsAttr()
        for time, pose in enumerate(poses):
            attribute.Set(vec3f(np.reshape(pose, (8, 3))), float(time))
        stage.GetRootLayer().Save()
        ends_well("check", path)


def test_records_of_layers_to_join(folder: Path) -> None:
    stage = cube_file(folder / "in.usda", times=[1.0, 2.0])
    parts = [folder / "part1.usda", folder / "part2.usda"]
    for number, part in enumerate(parts, start=1):
        assert run("repair", stage, "--frames", number, "-o", part).code == 0
    good = parts[1].read_bytes()
    record = dict(Sdf.Layer.FindOrOpen(str(parts[1])).customLayerData["dtrepair"])

    @fuzzed
    @given(st.sampled_from(sorted(record)), VALUE)
    def entries(name: str, value: Any) -> None:
        with new(folder, "usda") as path:
            path.write_bytes(good)
            layer = Sdf.Layer.FindOrOpen(str(path))
            changed = {key: kept for key, kept in record.items() if key != name}
            layer.customLayerData = {"dtrepair": {**changed, **usd_dictionary({name: value})}}
            layer.Save()
            ends_well("join", parts[0], path, "-o", folder / "joined.usda", codes=(0, 2, 3))

    @fuzzed
    @given(damaged(good))
    def bytes_of_text(data: bytes) -> None:
        with new(folder, "usda") as path:
            path.write_bytes(data)
            ends_well("join", parts[0], path, "-o", folder / "joined.usda", codes=(0, 2, 3))

    entries()
    bytes_of_text()
