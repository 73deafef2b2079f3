"""Mesh files of random damage: obj, off, ply, glb."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dtrepair.files.mesh_files import MeshFileError, read_mesh, write_mesh
from tests.fuzz.damage import REAL, WHOLE, WORD, damaged, ends_well, fuzzed, replaced
from tests.meshes import icosphere

POINTS, FACES = icosphere(0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("meshes")


def check(folder: Path, name: str, data: bytes) -> None:
    """Check a file of these bytes."""
    path = folder / name
    path.write_bytes(data)
    ends_well("check", path, codes=(0, 1, 3))


def good(folder: Path, format: str) -> bytes:
    """A good file of a format."""
    from tests.command_line import write_obj

    source = write_obj(folder / "good.obj", POINTS, FACES)
    if format != "obj":
        mesh = read_mesh(source)
        write_mesh(folder / f"good.{format}", mesh, mesh.points)
    return (folder / f"good.{format}").read_bytes()


@pytest.mark.parametrize("format", ["obj", "off", "ply", "stl", "glb"])
def test_damaged_bytes(folder: Path, format: str) -> None:
    @fuzzed
    @given(damaged(good(folder, format)))
    def holds(data: bytes) -> None:
        check(folder, f"damaged.{format}", data)

    holds()


CORNER = st.one_of(
    WHOLE.map(str),
    st.tuples(WHOLE, WHOLE).map(lambda both: f"{both[0]}/{both[1]}"),
    st.sampled_from(["1", "2", "3", "-1", "1//1", "/", "1/", "x", "9" * 5000]),
)
NUMBER = st.one_of(REAL.map(str), st.sampled_from(["1", "2", "nan", "inf", "x", "", "1e999"]))
OBJ_LINE = st.one_of(
    st.lists(NUMBER, min_size=2, max_size=5).map(lambda words: "v " + " ".join(words)),
    st.lists(NUMBER, max_size=3).map(lambda words: "vt " + " ".join(words)),
    st.lists(CORNER, max_size=6).map(lambda words: "f " + " ".join(words)),
    WORD,
)


@fuzzed
@given(lines=st.lists(OBJ_LINE, max_size=12))
@example(lines=["v 0 0 0", "v 1 0 0", "v 0 1 0", "vt 0 0", "f 1/1 2/1 3/99999999999"])
def test_lines_of_obj(folder: Path, lines: list[str]) -> None:
    whole = ["v 0 0 0", "v 1 0 0", "v 0 1 0", "f 1 2 3", *lines]
    check(folder, "lines.obj", "\n".join(whole).encode())


PLY_TYPE = st.sampled_from(["float", "double", "int", "uchar", "char", "uint", "half", ""])
PLY_PROPERTY = st.one_of(
    st.tuples(PLY_TYPE, st.sampled_from(["x", "y", "z", "nx", "s", "t"])).map(
        lambda pair: f"property {pair[0]} {pair[1]}"
    ),
    st.tuples(PLY_TYPE, PLY_TYPE).map(
        lambda pair: f"property list {pair[0]} {pair[1]} vertex_indices"
    ),
    st.sampled_from(["property", "comment", "element face 1", "property float x", "element"]),
)


@fuzzed
@given(
    format=st.sampled_from(["ascii", "binary_little_endian", "binary_big_endian", "other"]),
    counts=st.tuples(WHOLE, WHOLE),
    properties=st.lists(PLY_PROPERTY, max_size=3),
    faces=st.lists(PLY_PROPERTY, max_size=2),
    body=st.binary(max_size=60) | st.lists(NUMBER, max_size=20).map(lambda w: " ".join(w).encode()),
)
def test_headers_of_ply(
    folder: Path,
    format: str,
    counts: tuple[int, int],
    properties: list[str],
    faces: list[str],
    body: bytes,
) -> None:
    axes = [f"property float {axis}" for axis in "xyz"]
    lines = ["ply", f"format {format} 1.0", f"element vertex {counts[0]}", *axes, *properties]
    lines += [f"element face {counts[1]}", *faces]
    lines += ["property list uchar int vertex_indices", "end_header", ""]
    check(folder, "header.ply", "\n".join(lines).encode() + body)


def test_documents_of_gltf(folder: Path) -> None:
    data = good(folder, "glb")
    (length,) = struct.unpack_from("<I", data, 12)
    document, rest = json.loads(data[20 : 20 + length]), data[20 + length :]

    @fuzzed
    @given(replaced(document))
    def holds(changed: Any) -> None:
        text = json.dumps(changed).encode()
        text += b" " * (-len(text) % 4)
        header = struct.pack("<4sII", b"glTF", 2, 20 + len(text) + len(rest))
        chunk = struct.pack("<II", len(text), 0x4E4F534A)
        check(folder, "document.glb", header + chunk + text + rest)

    holds()


def test_the_good_files_are_good(folder: Path) -> None:
    for format in ("obj", "off", "ply", "stl", "glb"):
        good(folder, format)
        assert len(read_mesh(folder / f"good.{format}").faces()) == 20
    with pytest.raises(MeshFileError):
        read_mesh(folder / "gone.obj")
    assert np.isfinite(POINTS).all()
