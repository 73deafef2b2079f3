"""Wavefront OBJ: polygons and texture coordinates in; out, the same file with moved vertices.

An OBJ that came from an OBJ keeps every line (comments, groups, materials, the order of all) except
the `v` lines of vertices that moved. Vertex normals go stale when a vertex moves, so then they are
left out.
"""

from __future__ import annotations

from itertools import chain
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.files.polygon_mesh import MeshFileError, PolygonMesh, polygon_mesh


def read_obj(data: bytes) -> PolygonMesh:
    """Read the bytes of an OBJ file. Raises MeshFileError with the line number."""
    text = data.decode("utf-8", errors="surrogateescape")
    lines = text.split("\n")
    points: list[list[float]] = []
    texture: list[list[float]] = []
    polygons: list[list[int]] = []
    texture_corners: list[int] = []
    face_lines: list[int] = []
    for number, line in enumerate(lines, 1):
        words = line.split()
        if not words:
            continue
        try:
            if words[-1].endswith("\\"):
                raise ValueError("a line continued by a backslash; write it as one line")
            if words[0] == "v":
                points.append(_floats(words[1:4], 3))
            elif words[0] == "vt":
                texture.append([*_floats(words[1:3], 1), 0.0][:2])
            elif words[0] == "f":
                vertices, rows = _corners(words[1:], len(points), len(texture))
                face_lines.append(number)
                polygons.append(vertices)
                texture_corners += rows
        except ValueError as error:
            raise MeshFileError(f"line {number}: {error}") from None
    if max(chain.from_iterable(polygons), default=-1) >= len(points):
        highest = [max(polygon, default=-1) for polygon in polygons]
        first = next(row for row, index in enumerate(highest) if index >= len(points))
        # Counted from 1, as in the file.
        raise MeshFileError(
            f"line {face_lines[first]}: expected vertex indices up to {len(points)} (the vertex "
            f"count), got {highest[first] + 1}"
        )
    more: dict[str, Any] = {"original": text}
    # Some exporters leave indices of coordinates that they did not write.
    if any(0 <= row < len(texture) for row in texture_corners):
        more["texture"] = np.asarray(texture)
        written = [row if row < len(texture) else -1 for row in texture_corners]
        more["texture_corners"] = np.asarray(written, dtype=np.int32)
    return polygon_mesh("obj", points, polygons, **more)


def write_obj(mesh: PolygonMesh, points: NDArray[np.float64]) -> bytes:
    """Return the bytes of an OBJ file with `points` (V, 3); untouched vertices keep their text."""
    if mesh.format == "obj":
        return _patched(mesh, points)
    lines = [f"v {text}" for text in _texts(points)]
    rows = None
    if mesh.texture is not None and mesh.texture_corners is not None:
        lines += [f"vt {text}" for text in _texts(mesh.texture)]
        rows = mesh.texture_corners
    start = 0
    for count in mesh.counts:
        corners = slice(start, start + int(count))
        words = [str(v + 1) for v in mesh.corners[corners]]
        if rows is not None:
            words = [f"{v}/{r + 1}" for v, r in zip(words, rows[corners], strict=True)]
        lines.append("f " + " ".join(words))
        start = corners.stop
    return ("\n".join(lines) + "\n").encode()


def _patched(mesh: PolygonMesh, points: NDArray[np.float64]) -> bytes:
    """Return the bytes of the mesh's own file with the lines of moved vertices replaced."""
    moved = mesh.changed(points)
    text: str = mesh.original
    if not moved.any():
        return text.encode("utf-8", errors="surrogateescape")
    result = []
    texts = iter(_texts(points[moved]))
    vertex = 0
    for line in text.split("\n"):
        words = line.split()
        kind = words[0] if words else ""
        if kind == "v":
            if moved[vertex]:
                line = " ".join(["v", next(texts), *words[4:]])
            vertex += 1
        elif kind == "f":
            if "/" in line:
                words = [_without_normal(word) for word in words]
            line = " ".join(words)
        if kind != "vn":
            result.append(line)
    return "\n".join(result).encode("utf-8", errors="surrogateescape")


def _texts(rows: NDArray[np.float64]) -> list[str]:
    """Return points or texture coordinates (N, K) as words of a line each."""
    # The shortest text that reads back as the same float32: what was counted is what is written.
    return [" ".join(words) for words in rows.astype(np.float32).astype(np.str_).tolist()]


def _without_normal(word: str) -> str:
    """Return the word of a face's corner without its vertex normal: `1/2/3` becomes `1/2`."""
    indices = word.split("/")[:2]
    return indices[0] if indices[1:] in ([], [""]) else "/".join(indices)


def _floats(words: list[str], least: int) -> list[float]:
    """Return words as at least `least` finite numbers. Raises ValueError."""
    if len(words) < least:
        raise ValueError(f"expected {least} numbers, got {len(words)}")
    values = [float(word) for word in words]
    if not all(map(isfinite, values)):
        raise ValueError("expected finite numbers, got NaN or infinity")
    return values


def _corners(words: list[str], vertices: int, textures: int) -> tuple[list[int], list[int]]:
    """Return vertex and texture row (-1 for none) of each corner of a face, counted from 0."""
    if not any("/" in word for word in words):
        return [_index(word, vertices) for word in words], [-1] * len(words)
    indices = [[*word.split("/"), ""] for word in words]
    rows = [_index(texture, textures) if texture else -1 for _, texture, *_ in indices]
    return [_index(vertex, vertices) for vertex, *_ in indices], rows


def _index(word: str, count: int) -> int:
    """Return an index of the file, counted from 1 or back from the end, counted from 0.

    Raises ValueError for 0 and for an index before the first entry.
    """
    index = int(word)
    if index > 0:
        return index - 1
    # A negative index counts back from the newest entry.
    if index == 0 or count + index < 0:
        raise ValueError(f"expected an index from 1, or a valid negative one, got {word}")
    return count + index
