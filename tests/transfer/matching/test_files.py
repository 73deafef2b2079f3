"""Marker and correspondence files."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtrepair.transfer import (
    identity_pairs,
    read_correspondence,
    read_markers,
    write_correspondence,
)
from tests.meshes import icosphere, torus

SOURCE, TARGET = icosphere(1)[1], torus(8, 5)[1]


def written(folder: Path, text: str, name: str = "pairs.cons") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "3\n1, 2\n3, 4\n5, 6\n",
        "3\n1, 2\n3, 4\n5, 6",
        "1 2\n3\t4\n5 6\n",
        "# markers\n1 2 # nose\n\n3 4\n5,6\n",
        "3\r\n1, 2\r\n3, 4\r\n5, 6\r\n",
    ],
)
def test_markers_of_every_layout(tmp_path: Path, text: str) -> None:
    rows = read_markers(written(tmp_path, text), source_count=9, target_count=9)
    assert rows.dtype == np.int32
    np.testing.assert_array_equal(rows, [[1, 2], [3, 4], [5, 6]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("4\n1, 2\n3, 4\n", "announces 4 rows, got 2.*complete"),
        ("1, 2\n3\n", "line 2: expected 2 numbers, got 1"),
        ("2\n1, 2\n3, 4, 5\n", "line 3: expected 2 numbers, got 3"),
        ("1 2\n3 x\n", "line 2: expected an integer, got 'x'"),
        ("1 2.5\n", "expected an integer, got '2.5'"),
        ("", "expected lines of 2 numbers, got none"),
        ("0\n", "expected lines of 2 numbers, got none"),
        ("1 2\n1 3\n", "vertex 1 in markers 0 and 1"),
        ("1 2\n3 2\n", "vertex 2 in markers 0 and 1"),
        ("1 2\n8 3\n", "source vertices 0..7, got index 8"),
        ("1 2\n-1 3\n", "got index -1"),
    ],
)
def test_wrong_marker_files_name_the_file_and_the_line(
    tmp_path: Path, text: str, message: str
) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ValueError, match=message) as caught:
        read_markers(path, source_count=8, target_count=8)
    assert str(caught.value).startswith(str(path))


def test_markers_without_counts_are_read_but_never_negative(tmp_path: Path) -> None:
    assert read_markers(written(tmp_path, "1000 2\n")).tolist() == [[1000, 2]]
    with pytest.raises(ValueError, match="index -1"):
        read_markers(written(tmp_path, "4 2\n-1 3\n"))


def test_bytes_that_are_no_text_and_missing_files(tmp_path: Path) -> None:
    path = tmp_path / "noise.cons"
    path.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(ValueError, match="expected a text file"):
        read_markers(path)
    with pytest.raises(OSError):
        read_markers(tmp_path / "missing.cons")


def test_tricorrs_hold_a_distance_that_is_not_needed(tmp_path: Path) -> None:
    path = written(tmp_path, "2\n0, 4, 0.125\n3, 1, 1e-4\n", "horse.tricorrs")
    assert read_correspondence(path, SOURCE, TARGET).tolist() == [[0, 4], [3, 1]]
    path = written(tmp_path, "2\n0, 4, 0.125\n300, 1, 1e-4\n", "horse.tricorrs")
    with pytest.raises(
        ValueError, match=r"horse.tricorrs: .*source triangles 0..79, got index 300"
    ):
        read_correspondence(path, SOURCE, TARGET)


@pytest.mark.parametrize("name", ["pairs.npz", "pairs.txt"])
def test_a_written_correspondence_reads_back(tmp_path: Path, name: str) -> None:
    pairs = np.array([[0, 3], [2, 1], [79, 79]])
    write_correspondence(tmp_path / name, pairs, SOURCE, TARGET)
    found = read_correspondence(tmp_path / name, SOURCE.astype(np.int64), TARGET)
    np.testing.assert_array_equal(found, pairs)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_correspondence_of_other_meshes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pairs.npz"
    write_correspondence(path, identity_pairs(SOURCE), SOURCE, SOURCE)
    with pytest.raises(ValueError, match="made for a target of 80 triangles, got one of 320"):
        read_correspondence(path, SOURCE, icosphere(2)[1])
    with pytest.raises(
        ValueError, match="made for a source whose triangles are numbered otherwise"
    ):
        read_correspondence(path, SOURCE[::-1], SOURCE)
    with pytest.raises(ValueError, match="made for a target whose triangles"):
        read_correspondence(path, SOURCE, SOURCE[:, [1, 2, 0]])


def test_files_that_are_no_correspondence_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "pairs.npz"
    path.write_bytes(b"PK nothing")
    with pytest.raises(ValueError, match="written by write_correspondence"):
        read_correspondence(path, SOURCE, TARGET)
    np.savez(path, pairs=identity_pairs(SOURCE))
    with pytest.raises(ValueError, match=r"got entries \['pairs'\]"):
        read_correspondence(path, SOURCE, TARGET)
    with pytest.raises(ValueError, match=r"source triangles 0..79, got index 99"):
        write_correspondence(tmp_path / "new.npz", np.array([[99, 0]]), SOURCE, TARGET)
    assert not (tmp_path / "new.npz").exists()


def test_a_damaged_npz_is_refused_wherever_the_damage_is(tmp_path: Path) -> None:
    faces = icosphere(0)[1]
    path = tmp_path / "good.npz"
    write_correspondence(path, np.array([[0, 0]]), faces, faces)
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            assert read_correspondence(path, faces, faces).tolist() == [[0, 0]]
        except ValueError as error:
            assert str(error).startswith(f"{path}: ")


def test_an_npz_that_announces_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    faces = icosphere(0)[1]
    path = tmp_path / "huge.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("format", "pairs", "counts", "hashes"):
            with archive.open(f"{name}.npy", "w") as file:
                header = {"descr": "<i8", "fortran_order": False, "shape": (10**11,)}
                np.lib.format.write_array_header_1_0(file, header)
    with pytest.raises(ValueError, match=r"huge\.npz: expected an npz"):
        read_correspondence(path, faces, faces)


def test_entries_of_other_shapes_are_refused(tmp_path: Path) -> None:
    faces = icosphere(0)[1]
    path = tmp_path / "other.npz"
    entries: dict[str, Any] = {
        "format": "dtrepair.correspondence/1",
        "pairs": [[0, 0]],
        "counts": 3,
    }
    np.savez_compressed(path, allow_pickle=False, **entries)
    with pytest.raises(ValueError, match="got entries"):
        read_correspondence(path, faces, faces)


def test_an_index_that_no_integer_holds_is_refused(tmp_path: Path) -> None:
    faces = icosphere(0)[1]
    path = written(tmp_path, f"{'9' * 30} 0\n", "pairs.txt")
    with pytest.raises(ValueError, match=r"pairs\.txt: expected indices below"):
        read_correspondence(path, faces, faces)
