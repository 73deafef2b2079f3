"""PLY, ascii and binary: polygons in; out, the same file with moved vertices.

A PLY that came from a PLY keeps every element and property. Only x, y, z of the vertices that moved
change, and nx, ny, nz, which are computed anew once something moved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.files.polygon_mesh import MeshFileError, PolygonMesh, polygon_mesh, vertex_normals

_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}


@dataclass(frozen=True)
class _Element:
    """An element of the header: so many records of the same properties."""

    name: str
    count: int
    properties: list[tuple[str, str, str]]  # name, value type, count type ("" for a scalar)

    def record(self, order: str) -> np.dtype[Any]:
        """Return the type of a record without lists, in a byte order ("<" or ">")."""
        return np.dtype([(name, order + value) for name, value, _ in self.properties])

    def least_bytes(self, order: str) -> int:
        """Return the bytes that a record has at least; "" is ascii: a digit and a blank each."""
        if not order:
            return max(2 * len(self.properties), 1)
        return sum(np.dtype(count or value).itemsize for _, value, count in self.properties)

    def has_list(self) -> bool:
        """Return whether a property is a list."""
        return any(count for _, _, count in self.properties)


@dataclass(frozen=True)
class _Original:
    """The bytes of the file a mesh was read from, and where its vertices are."""

    data: bytes
    order: str  # "<", ">", or "" for ascii
    start: int  # of the vertex records in `data`
    stop: int
    vertices: NDArray[Any]  # structured; ascii values as float64


def read_ply(data: bytes) -> PolygonMesh:
    """Read the bytes of a PLY file. Raises MeshFileError."""
    try:
        order, elements, position = _header(data)
        read = _read_ascii if order == "" else _read_binary
        vertices, polygons, span = read(data, order, elements, position)
    except (KeyError, IndexError, TypeError, ValueError, UnicodeDecodeError) as error:
        raise MeshFileError(f"not a readable PLY file: {error}") from None
    points = np.stack([vertices[axis].astype(np.float64) for axis in "xyz"], axis=1)
    more: dict[str, Any] = {"original": _Original(data, order, *span, vertices)}
    for u, v in (("s", "t"), ("u", "v"), ("texture_u", "texture_v")):
        if u in (vertices.dtype.names or ()) and v in (vertices.dtype.names or ()):
            more["texture"] = np.stack([vertices[u], vertices[v]], axis=1).astype(np.float64)
    mesh = polygon_mesh("ply", points, polygons, **more)
    if mesh.texture is None:
        return mesh
    return polygon_mesh("ply", points, polygons, texture_corners=mesh.corners, **more)


def write_ply(mesh: PolygonMesh, points: NDArray[np.float64]) -> bytes:
    """Return the bytes of a PLY file with `points` (V, 3); untouched vertices keep their bytes."""
    return _patched(mesh, points) if mesh.format == "ply" else _fresh(mesh, points)


def _header(data: bytes) -> tuple[str, list[_Element], int]:
    """Return byte order ("" for ascii), elements, and where the header ends. Raises ValueError."""
    end = data.find(b"end_header")
    newline = data.find(b"\n", end)
    if not data.startswith(b"ply") or end < 0 or newline < 0:
        raise ValueError("expected a header from 'ply' to 'end_header', got none")
    order, elements = "", []
    for line in data[:end].decode("ascii", errors="replace").splitlines()[1:]:
        words = line.split()
        if words[:1] == ["format"]:
            order = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2]), []))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append((words[4], _TYPES[words[3]], _TYPES[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append((words[2], _TYPES[words[1]], ""))
    vertex = next((e for e in elements if e.name == "vertex"), None)
    if vertex is None or vertex.has_list():
        raise ValueError("expected an element 'vertex' with plain numbers, got none")
    if not {"x", "y", "z"} <= {name for name, _, _ in vertex.properties}:
        raise ValueError("expected vertices with x, y and z")
    _check_counts(elements, order, len(data) - newline)
    return order, elements, newline + 1


def _check_counts(elements: list[_Element], order: str, room: int) -> None:
    """Raise ValueError where the header announces more than so many bytes hold."""
    for element in elements:
        if element.count < 0 or element.count * element.least_bytes(order) > room:
            raise ValueError(
                f"the file ends early: {element.count} of {element.name!r} are announced, and "
                f"there are {room} bytes"
            )


def _read_binary(
    data: bytes, order: str, elements: list[_Element], position: int
) -> tuple[NDArray[Any], Any, tuple[int, int]]:
    """Return the vertex records, the polygons, and the vertices' span of bytes."""
    vertices: Any = None
    polygons: Any = []
    span = (0, 0)
    for element in elements:
        if not element.has_list():
            record = element.record(order)
            if position + element.count * record.itemsize > len(data):
                raise ValueError("the file ends early")
            if element.name == "vertex":
                vertices = np.frombuffer(data, record, element.count, position)
                span = (position, position + element.count * record.itemsize)
            position += element.count * record.itemsize
        else:
            lists, position = _binary_lists(data, order, element, position)
            polygons = lists if element.name == "face" else polygons
    return vertices, polygons, span


def _binary_lists(data: bytes, order: str, element: _Element, position: int) -> tuple[Any, int]:
    """Read rows with lists; rows of one length, the usual case, are read at once."""
    if element.count:
        row = _row_type(data, order, element, position)
        if position + element.count * row.itemsize <= len(data):
            rows = np.frombuffer(data, row, element.count, position)
            lengths = [name for name in row.names or () if name.startswith("#")]
            if all((rows[name] == rows[name][0]).all() for name in lengths):
                return rows[_index_property(element)], position + rows.nbytes
    result = []
    for _ in range(element.count):
        row = _row_type(data, order, element, position)
        result.append(np.frombuffer(data, row, 1, position)[_index_property(element)][0])
        position += row.itemsize
    return result, position


def _row_type(data: bytes, order: str, element: _Element, position: int) -> np.dtype[Any]:
    """Return the type of the record with lists that starts at a position."""
    fields: list[Any] = []
    for name, value, count in element.properties:
        if not count:
            fields.append((name, order + value))
            position += np.dtype(value).itemsize
            continue
        length = int(np.frombuffer(data, order + count, 1, position)[0])
        fields += [("#" + name, order + count), (name, order + value, (length,))]
        position += np.dtype(count).itemsize + length * np.dtype(value).itemsize
    return np.dtype(fields)


def _index_property(element: _Element) -> str:
    """Return the name of the list of vertex indices."""
    names = [name for name, _, count in element.properties if count]
    for name in ("vertex_indices", "vertex_index"):
        if name in names:
            return name
    return names[0]


def _read_ascii(
    data: bytes, order: str, elements: list[_Element], position: int
) -> tuple[NDArray[Any], Any, tuple[int, int]]:
    """Return the vertex records, the polygons, and the vertices' span of bytes."""
    vertices: Any = None
    polygons: list[list[int]] = []
    span = (0, 0)
    for element in elements:
        start, rows = position, []
        for _ in range(element.count):
            stop = data.find(b"\n", position)
            stop = len(data) if stop < 0 else stop
            rows.append(data[position:stop].split())
            position = stop + 1
        if element.name == "vertex":
            names = [name for name, _, _ in element.properties]
            table = np.asarray(rows, dtype=np.float64).reshape(element.count, len(names))
            vertices = np.zeros(element.count, dtype=[(name, np.float64) for name in names])
            for column, name in enumerate(names):
                vertices[name] = table[:, column]
            span = (start, min(position, len(data)))
        elif element.name == "face":
            polygons = [_ascii_list(row, element) for row in rows]
    return vertices, polygons, span


def _ascii_list(words: list[bytes], element: _Element) -> list[int]:
    """Return the vertex indices of a face's words. Raises ValueError where there are none."""
    index_name = _index_property(element)
    at = 0
    for name, _, count in element.properties:
        length = int(words[at]) if count else 1
        if name == index_name:
            return [int(word) for word in words[at + 1 : at + 1 + length]]
        at += length + (1 if count else 0)
    raise ValueError("a face without vertex indices")


def _patched(mesh: PolygonMesh, points: NDArray[np.float64]) -> bytes:
    """Return the bytes of the mesh's own file with new positions and normals."""
    original: _Original = mesh.original
    moved = mesh.changed(points)
    if not moved.any():
        return original.data
    vertices = original.vertices.copy()
    for column, axis in enumerate("xyz"):
        vertices[axis][moved] = points[moved, column].astype(np.float32)
    names = vertices.dtype.names or ()
    if {"nx", "ny", "nz"} <= set(names):
        normals = vertex_normals(points, mesh.faces())
        for column, name in enumerate(("nx", "ny", "nz")):
            vertices[name] = normals[:, column]
    if original.order:
        block = vertices.tobytes()
    else:
        block = _ascii_block(original, vertices, moved)
    return original.data[: original.start] + block + original.data[original.stop :]


def _ascii_block(original: _Original, vertices: NDArray[Any], moved: NDArray[np.bool_]) -> bytes:
    """Return the lines of the vertices with new words where they changed."""
    lines = original.data[original.start : original.stop].splitlines()
    names = list(vertices.dtype.names or ())
    for index, line in enumerate(lines):
        words = line.split()
        changing = ("x", "y", "z") if moved[index] else ()
        for name in (*changing, *(n for n in ("nx", "ny", "nz") if n in names)):
            words[names.index(name)] = str(np.float32(vertices[name][index])).encode()
        lines[index] = b" ".join(words) if changing or "nx" in names else line
    return b"\n".join(lines) + b"\n"


def _fresh(mesh: PolygonMesh, points: NDArray[np.float64]) -> bytes:
    """Return the bytes of a new binary PLY file."""
    columns = [points.astype("<f4")]
    names = ["x", "y", "z"]
    if mesh.texture is not None and mesh.has_vertex_texture():
        columns.append(mesh.texture.astype("<f4"))
        names += ["s", "t"]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"]
    header += [f"property float {name}" for name in names]
    header += [f"element face {len(mesh.counts)}", "property list int int vertex_indices"]
    starts = np.cumsum(mesh.counts) - mesh.counts
    # A list is its length and its values: both int32, so the whole element is one array.
    lists = np.insert(mesh.corners, starts, mesh.counts).astype("<i4")
    text = "\n".join([*header, "end_header"]) + "\n"
    return text.encode() + np.concatenate(columns, axis=1).tobytes() + lists.tobytes()
