"""Marker and correspondence files: `.cons`, `.tricorrs`, two-column text, and npz with hashes."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.files.archives import DAMAGE, check_archive
from dtrepair.files.atomic import atomic_output
from dtrepair.numerics.geometry import IntArray
from dtrepair.transfer.arrays import Array, to_numpy
from dtrepair.transfer.matching.correspondence import checked_pairs
from dtrepair.transfer.matching.markers import checked_markers

FORMAT = "dtrepair.correspondence/1"
# Entries of an npz besides the pairs: the format, and a number and a hash for each mesh.
_SHAPES: dict[str, tuple[int, ...]] = {"format": (), "counts": (2,), "hashes": (2,)}


def read_markers(
    path: str | os.PathLike[str],
    *,
    source_count: int | None = None,
    target_count: int | None = None,
) -> IntArray:
    """Return markers (K, 2) int32 of (source vertex, target vertex), 0-based.

    Reads `.cons` (a count, then "source, target" lines) and text of two columns separated by
    blanks or a comma; `#` begins a comment. Raises ValueError with the line for what is not that,
    for a count that differs, for vertices given twice and, with the vertex counts of the meshes,
    for vertices out of range; OSError for a file that cannot be read.
    """
    rows = _read_rows(Path(path), columns=(2,))[:, :2]
    highest = rows.max(axis=0, initial=-1) + 1
    counts = (source_count, target_count)
    limits = [int(high) if n is None else n for n, high in zip(counts, highest, strict=True)]
    with _named(Path(path)):
        return checked_markers(rows, *limits)


def read_correspondence(
    path: str | os.PathLike[str], source_faces: Array, target_faces: Array
) -> IntArray:
    """Return pairs (K, 2) int32 of (source triangle, target triangle), 0-based.

    Reads the npz of `write_correspondence` (refused if it was made for other faces), `.tricorrs`
    (a count, then "source, target, squared distance" lines) and text of two or three columns.
    Raises ValueError with the line or the mesh that differs; OSError for a file that cannot be
    read.
    """
    location = Path(path)
    faces = to_numpy(source_faces), to_numpy(target_faces)
    if location.suffix.lower() == ".npz":
        with _named(location):
            rows = _read_npz(location, faces)
    else:
        rows = _read_rows(location, columns=(2, 3))[:, :2]
    with _named(location):
        return checked_pairs(rows, len(faces[0]), len(faces[1]))


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Raise a ValueError again with the file's name in front."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_correspondence(
    path: str | os.PathLike[str], pairs: Array, source_faces: Array, target_faces: Array
) -> None:
    """Write pairs (K, 2), whole or not at all; the name chooses the format.

    `.npz` holds the pairs, the triangle counts and a hash of both face arrays; any other name
    gets a count and "source, target" lines. Raises ValueError for pairs out of range, OSError.
    """
    faces = to_numpy(source_faces), to_numpy(target_faces)
    rows = checked_pairs(pairs, len(faces[0]), len(faces[1]))
    with atomic_output(path) as temporary:
        if Path(path).suffix.lower() == ".npz":
            np.savez_compressed(
                temporary,
                format=np.array(FORMAT),
                pairs=rows,
                counts=np.array([len(faces[0]), len(faces[1])]),
                hashes=np.array([faces_hash(faces[0]), faces_hash(faces[1])]),
            )
        else:
            lines = [str(len(rows)), *(f"{first}, {second}" for first, second in rows)]
            temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def faces_hash(faces: ArrayLike) -> str:
    """Return the SHA-256 of a face array (F, 3) as little-endian int32, whatever its type."""
    data = np.ascontiguousarray(to_numpy(faces), dtype="<i4")
    return hashlib.sha256(data.tobytes()).hexdigest()


def _read_npz(path: Path, faces: tuple[NDArray[np.integer], ...]) -> NDArray[np.integer]:
    """Return the array of pairs of an npz file. Raises ValueError."""
    expected = "expected an npz written by write_correspondence"
    data = path.read_bytes()
    try:
        check_archive(data)
        with np.load(BytesIO(data), allow_pickle=False) as archive:
            content = {name: archive[name] for name in (*_SHAPES, "pairs") if name in archive.files}
            found = sorted(archive.files)
    except DAMAGE as error:
        raise ValueError(
            f"{expected}, got a file that is none ({error}): write it again"
        ) from error
    shapes = {name: array.shape for name, array in content.items() if name != "pairs"}
    if "pairs" not in content or shapes != _SHAPES or str(content["format"]) != FORMAT:
        raise ValueError(f"{expected}, got entries {found}: write it again")
    for index, name in enumerate(("source", "target")):
        if content["counts"][index] != len(faces[index]):
            raise ValueError(
                f"made for a {name} of {content['counts'][index]} triangles, got one of "
                f"{len(faces[index])}: match the meshes again"
            )
        if str(content["hashes"][index]) != faces_hash(faces[index]):
            raise ValueError(
                f"made for a {name} whose triangles are numbered otherwise: match the meshes again"
            )
    pairs: NDArray[np.integer] = content["pairs"]
    return pairs


def _read_rows(path: Path, *, columns: tuple[int, ...]) -> NDArray[np.int64]:
    """Return integer rows of a text file; a first line of one number is their count."""
    lines = [
        (number, line.partition("#")[0].replace(",", " ").split())
        for number, line in enumerate(_text(path).splitlines(), start=1)
    ]
    lines = [(number, fields) for number, fields in lines if fields]
    announced = None
    if lines and len(lines[0][1]) == 1:
        announced = _integer(path, lines[0][0], lines[0][1][0])
        lines = lines[1:]
    if not lines:
        raise ValueError(f"{path}: expected lines of {_either(columns)} numbers, got none")
    rows = []
    for number, fields in lines:
        if len(fields) not in columns:
            raise ValueError(
                f"{path}, line {number}: expected {_either(columns)} numbers, got {len(fields)}"
            )
        # A third column is the squared distance of the match; it is not needed.
        rows.append([_integer(path, number, field) for field in fields[:2]])
    if announced is not None and announced != len(rows):
        raise ValueError(
            f"{path}: the first line announces {announced} rows, got {len(rows)}: "
            "is the file complete?"
        )
    try:
        return np.array(rows, dtype=np.int64)
    except OverflowError:
        raise ValueError(f"{path}: expected indices below 2**63, got a larger one") from None


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected a text file, got bytes that are no text") from error


def _integer(path: Path, number: int, field: str) -> int:
    try:
        return int(field)
    except ValueError:
        raise ValueError(f"{path}, line {number}: expected an integer, got {field!r}") from None


def _either(columns: tuple[int, ...]) -> str:
    return " or ".join(map(str, columns))
