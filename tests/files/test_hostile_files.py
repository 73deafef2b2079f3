"""Mesh files that announce more than they hold, or hold what no mesh has: refused in one line."""

from __future__ import annotations

import bz2
import json
import struct
import tracemalloc
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import pytest

from dtrepair.files.archives import check_archive
from dtrepair.files.mesh_files import MeshFileError, read_mesh

TRIANGLE = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
HUGE = 2**31


def ply(vertices: int = 3, faces: int = 1, names: str = "xyz", format: str = "ascii") -> str:
    """The header of a PLY."""
    lines = ["ply", f"format {format} 1.0", f"element vertex {vertices}"]
    lines += [f"property float {name}" for name in names]
    lines += [f"element face {faces}", "property list uchar int vertex_indices", "end_header"]
    return "\n".join(lines) + "\n"


def glb(document: object) -> bytes:
    """A binary glTF file of one document, without buffers."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text


@contextmanager
def small_memory(limit: int = 2**24) -> Iterator[None]:
    """Nothing in the block takes more than so many bytes."""
    import trimesh  # noqa: F401, loading it takes more

    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("vertices.ply", ply(vertices=HUGE) + TRIANGLE, "2147483648 of 'vertex' are ann"),
        ("faces.ply", ply(faces=HUGE) + TRIANGLE, "2147483648 of 'face' are ann"),
        ("binary.ply", ply(faces=HUGE, format="binary_little_endian") + "0" * 60, "of 'face'"),
        ("negative.ply", ply(vertices=-3) + TRIANGLE, "-3 of 'vertex' are ann"),
        ("names.ply", ply(names="abc") + TRIANGLE, "expected vertices with x, y and z"),
        ("parts.ply", ply().replace("list uchar int", "list uchar float") + TRIANGLE[:-2] + "1.5",
         "invalid literal for int"),
        ("digits.obj", OBJ + f"f 1 2 {'9' * 5000}\n", "line 4"),
        ("index.obj", OBJ + "f 1 2 99999999999999999999\n", "expected vertex indices up to 3"),
        ("range.obj", OBJ + "v 1e300 0 0\nf 1 2 3\n", "expected coordinates up to 3.4e38"),
        ("vertices.off", f"OFF\n{HUGE} 1 0\n0 0 0\n", "the file ends early"),
        ("negative.off", "OFF\n-3 -1 0\n0 0 0\n", "the file ends early"),
        ("pairs.off", "OFF\n3 1 0\n0 0\n1 0\n0 1\n3 0 1 2\n", "not a readable OFF"),
        ("corners.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n9 0 1 2\n", "not a readable OFF"),
        ("array.glb", glb({"accessors": [{"count": HUGE}]}), "2147483648 values in"),
        ("negative.glb", glb({"accessors": [{"count": -1}]}), "-1 values in"),
        ("list.glb", glb([1, 2]), "not a readable glb file"),
        ("deep.gltf", "[" * 100_000, "nested too deeply"),
        ("short.glb", b"glTF\x02", "not a readable glb file"),
    ],
)  # fmt: skip
def test_a_file_that_holds_no_mesh_is_refused_in_one_line(
    tmp_path: Path, name: str, content: str | bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with small_memory(), pytest.raises(MeshFileError, match=words) as caught:
        read_mesh(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


@pytest.mark.parametrize("row", [77, 99_999_999_999])
def test_an_index_of_no_texture_coordinate_is_left_out(tmp_path: Path, row: int) -> None:
    path = tmp_path / "a.obj"
    path.write_text(f"{OBJ}vt 0 0\nf 1/1 2/1 3/{row}\n")
    mesh = read_mesh(path)
    assert mesh.texture_corners is not None and mesh.texture_corners.tolist() == [0, 0, -1]


def packed(size: int) -> bytes:
    """A zip of a file of zeros; what is beyond 16 MiB is announced only."""
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("mesh.obj", "w", force_zip64=True) as file:
            file.write(bytes(min(size, 2**24)))
    data = bytearray(stream.getvalue())
    # The directory's entry announces it, 24 bytes from its start.
    struct.pack_into("<I", data, data.rindex(b"PK\x01\x02") + 24, size)
    return bytes(data)


def test_archives_are_refused_by_the_size_that_they_announce(tmp_path: Path) -> None:
    check_archive(packed(2**24))
    data = packed(2**29)
    assert len(data) < 2**20
    path = tmp_path / "mesh.zip"
    path.write_bytes(data)
    with small_memory(), pytest.raises(MeshFileError, match="bytes unpacks to 536870912"):
        read_mesh(path)


def test_damaged_archives(tmp_path: Path) -> None:
    for name, data in (("a.zip", b"PK\x03\x04" + b"x" * 50), ("a.bz2", b"BZh9" + b"x" * 50)):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(MeshFileError, match="the archive is damaged"):
            read_mesh(tmp_path / name)


def test_a_compressed_file_is_unpacked_no_further_than_needed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("dtrepair.files.archives.UNPACKED", 2**16)
    check_archive(bz2.compress(bytes(2**10)))
    with pytest.raises(ValueError, match="unpacks to 65537 or more"):
        check_archive(bz2.compress(bytes(2**24)))
