"""Mesh files: obj, ply and off with their polygons; stl, glb and others through trimesh.

Vertex order, faces and texture coordinates stay as the file has them; untouched points are written
back bit for bit. STL stores no shared vertices, so equal positions are joined when reading.
"""

from __future__ import annotations

import json
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.files.archives import check_archive, is_archive
from dtrepair.files.atomic import write_atomically
from dtrepair.files.obj import read_obj, write_obj
from dtrepair.files.ply import read_ply, write_ply
from dtrepair.files.polygon_mesh import MeshFileError, PolygonMesh, polygon_mesh

__all__ = ["WRITABLE", "MeshFileError", "PolygonMesh", "losses", "read_mesh", "write_mesh"]

WRITABLE = ("obj", "ply", "off", "stl", "glb")
_POLYGONS = ("obj", "ply", "off")


def read_mesh(path: str | os.PathLike[str]) -> PolygonMesh:
    """Read one mesh file; the format follows from the extension.

    Raises MeshFileError: no such file, not readable as this format, no faces, several meshes in one
    file, coordinates that are not finite, or face indices out of range.
    """
    source = Path(path)
    format = _format(source)
    try:
        data = source.read_bytes()
    except OSError as error:
        raise MeshFileError(f"{source}: cannot be read: {error.strerror}") from None
    if not data:
        raise MeshFileError(f"{source}: the file is empty (0 bytes); export it again")
    readers = {"obj": read_obj, "ply": read_ply, "off": _read_off}
    try:
        mesh = readers[format](data) if format in readers else _read_trimesh(data, format)
        _check(mesh)
    except MeshFileError as error:
        cure = "" if ";" in str(error) else "; mend the file or export it again"
        raise MeshFileError(f"{source}: {error}{cure}") from None
    except (ArithmeticError, LookupError, MemoryError, TypeError, ValueError) as error:
        # Numbers that no array holds, words that are missing: whatever a damaged file leads to.
        raise MeshFileError(
            f"{source}: not a readable {format} file: {error or type(error).__name__}; mend the "
            "file or export it again"
        ) from error
    return mesh


def write_mesh(path: str | os.PathLike[str], mesh: PolygonMesh, points: ArrayLike) -> None:
    """Write `mesh` with `points` (V, 3), rounded to float32, to a file, whole or not at all.

    A file of the input's own format keeps everything else of it. `losses` tells what another format
    drops. Raises MeshFileError for a format that cannot be written, ValueError, OSError.
    """
    format = writable_format(path)
    mesh.changed(points)  # shape and finiteness
    rounded = np.asarray(points).astype(np.float32).astype(np.float64)
    writers = {"obj": write_obj, "ply": write_ply, "off": _write_off}
    writer = writers.get(format)
    content = writer(mesh, rounded) if writer else _write_trimesh(mesh, rounded, format)
    write_atomically(path, content)


def writable_format(path: str | os.PathLike[str]) -> str:
    """Return the format of an output path. Raises MeshFileError where it cannot be written."""
    format = _format(Path(path))
    if format not in WRITABLE:
        raise MeshFileError(f"{path}: expected one of {', '.join(WRITABLE)} to write, got {format}")
    return format


def losses(mesh: PolygonMesh, format: str) -> tuple[str, ...]:
    """Say in short phrases what writing `mesh` as `format` drops."""
    lost = []
    if format not in _POLYGONS and (mesh.counts != 3).any():
        lost.append("polygons become triangles")
    if format == "stl" and mesh.format != "stl":
        lost.append("vertices are no longer shared")
    if mesh.texture is not None and format != mesh.format:
        per_corner = format in ("ply", "glb") and not mesh.has_vertex_texture()
        if format in ("off", "stl") or per_corner:
            lost.append("texture coordinates are dropped")
    return tuple(lost)


def _check(mesh: PolygonMesh) -> None:
    """Raise MeshFileError for a mesh without faces or with coordinates that are not finite."""
    if not len(mesh.points) or not len(mesh.faces()):
        raise MeshFileError("expected a mesh with faces, got none")
    if not np.isfinite(mesh.points).all():
        raise MeshFileError("expected finite coordinates, got NaN or infinity")
    largest = float(np.abs(mesh.points).max())
    if largest > float(np.finfo(np.float32).max):
        raise MeshFileError(f"expected coordinates up to 3.4e38 (float32), got {largest:.3g}")


def _format(path: Path) -> str:
    """Return the extension of a path in lower case. Raises MeshFileError where there is none."""
    format = path.suffix.lower().lstrip(".")
    if not format:
        what = "got a folder" if path.is_dir() else "got none"
        raise MeshFileError(f"{path}: expected a file extension such as .obj, {what}")
    return format


def _read_off(data: bytes) -> PolygonMesh:
    """Read the bytes of an OFF file. Raises MeshFileError."""
    lines = (line.partition("#")[0].split() for line in data.decode("utf-8", "replace").split("\n"))
    rows = [words for words in lines if words]
    try:
        if not rows or rows[0][0] != "OFF":
            raise ValueError("expected a first line OFF")
        rows = [rows[0][1:], *rows[1:]] if len(rows[0]) > 1 else rows[1:]
        vertices, polygons = int(rows[0][0]), int(rows[0][1])
        if min(vertices, polygons) < 0 or vertices + polygons >= len(rows):
            raise ValueError("the file ends early")
        points = [[float(row[axis]) for axis in range(3)] for row in rows[1 : 1 + vertices]]
        listed = rows[1 + vertices : 1 + vertices + polygons]
        corners = [[int(row[1 + k]) for k in range(int(row[0]))] for row in listed]
    except (IndexError, ValueError) as error:
        raise MeshFileError(f"not a readable OFF file: {error}") from None
    return polygon_mesh("off", points, corners, original=data)


def _write_off(mesh: PolygonMesh, points: NDArray[np.float64]) -> bytes:
    """Return the bytes of an OFF file with points (V, 3)."""
    moved = mesh.changed(points)
    if mesh.format == "off" and not moved.any():
        return bytes(mesh.original)
    # Untouched vertices keep the digits of their own file; moved ones are float32 values.
    lines = ["OFF", f"{len(points)} {len(mesh.counts)} 0"]
    for vertex, row in enumerate(points):
        values = row.astype(np.float32) if moved[vertex] else mesh.points[vertex]
        lines.append(" ".join(str(value) for value in values))
    for polygon in np.split(mesh.corners, np.cumsum(mesh.counts)[:-1]):
        lines.append(" ".join(str(value) for value in (len(polygon), *polygon)))
    return ("\n".join(lines) + "\n").encode()


def _read_trimesh(data: bytes, format: str) -> PolygonMesh:
    """Read the bytes of any other format with trimesh. Raises MeshFileError."""
    import trimesh

    if format not in trimesh.available_formats():
        raise MeshFileError(
            f"expected a mesh format such as {', '.join(WRITABLE)}, or a USD stage (.usd), got "
            f".{format}; check the path"
        )
    _check_sizes(data, format)
    stream = trimesh.util.wrap_as_stream(data)
    try:
        loaded: Any = trimesh.load_scene(stream, file_type=format, process=False)
        placed = loaded.dump(concatenate=False)
    except (ImportError, IndexError, KeyError):
        # Bytes that look like another variant of the format; the text would mislead.
        raise MeshFileError(f"not a readable {format} file: damaged or cut short") from None
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise MeshFileError(f"not a readable {format} file: {error}") from None
    meshes = [item for item in placed if isinstance(item, trimesh.Trimesh)]
    if not meshes:
        raise MeshFileError(f"not a readable {format} file: there is no mesh in it")
    if len(meshes) > 1:
        raise MeshFileError(f"expected one mesh in the file, got {len(meshes)}; convert it to USD")
    mesh = meshes[0]
    points, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces)
    if format.startswith("stl"):
        points, joined = np.unique(points.astype(np.float32), axis=0, return_inverse=True)
        return polygon_mesh("stl", points, joined.reshape(-1)[faces])
    more: dict[str, Any] = {"original": mesh}
    coordinates = getattr(mesh.visual, "uv", None)
    if coordinates is not None and len(coordinates) == len(points):
        more["texture"] = np.asarray(coordinates, dtype=np.float64)
        more["texture_corners"] = faces.reshape(-1).astype(np.int32)
    return polygon_mesh(format, points, faces, **more)


def _check_sizes(data: bytes, format: str) -> None:
    """Refuse a file that announces more than it holds, before trimesh makes room for it.

    Raises MeshFileError.
    """
    try:
        if is_archive(data):
            check_archive(data)
        elif format in ("glb", "gltf"):
            _check_accessors(data)
    except RecursionError:
        raise MeshFileError(f"not a readable {format} file: nested too deeply") from None
    except (LookupError, TypeError, ValueError, struct.error) as error:
        raise MeshFileError(f"not a readable {format} file: {error}") from None


def _check_accessors(data: bytes) -> None:
    """Raise ValueError for a glTF document with an array of more values than the file has bytes."""
    if data.startswith(b"glTF"):
        (length,) = struct.unpack_from("<I", data, 12)
        document = json.loads(data[20 : 20 + length])
    else:
        document = json.loads(data)
    for accessor in document["accessors"]:
        if not 0 <= accessor["count"] <= len(data):
            raise ValueError(f"an array of {accessor['count']} values in {len(data)} bytes")


def _write_trimesh(mesh: PolygonMesh, points: NDArray[np.float64], format: str) -> bytes:
    """Return the bytes of any other format with points (V, 3), written by trimesh."""
    import trimesh

    if isinstance(mesh.original, trimesh.Trimesh):
        result = mesh.original.copy()
        result.vertices = points
    else:
        result = trimesh.Trimesh(points, mesh.faces(), process=False)
        if mesh.has_vertex_texture():
            result.visual = trimesh.visual.TextureVisuals(uv=mesh.texture)
    content = result.export(file_type=format)
    return content if isinstance(content, bytes) else str(content).encode()
