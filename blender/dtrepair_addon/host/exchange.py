"""Meshes and results between Blender and the worker: a folder of JSON and npz, bit for bit."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float32]
COMMANDS = ("check", "repair")


@dataclass(frozen=True)
class SampledMesh:
    """An evaluated mesh at some frames.

    Attributes:
        name: of the object; two meshes of a request have different ones.
        counts: corners of each polygon (P,).
        corners: vertices of all polygons in a row (C,).
        points: local points (T, V, 3) float32 at each frame.
        matrices: local to world (T, 4, 4) at each frame, column vectors as in Blender.
        rest: local points (V, 3) float32 of the rest pose.
        rest_matrix: local to world (4, 4) in the rest pose.
        collider: takes part, but never moves.
        pin: (V,) from 0, free, to 1, fixed; None: all free.
        direction: (V, 3) preferred directions in world space, 0 for none; None: none.
    """

    name: str
    counts: NDArray[np.int32]
    corners: NDArray[np.int32]
    points: FloatArray
    matrices: NDArray[np.float64]
    rest: FloatArray
    rest_matrix: NDArray[np.float64]
    collider: bool = False
    pin: FloatArray | None = None
    direction: FloatArray | None = None


@dataclass(frozen=True)
class Request:
    """What the worker is asked: a command, the frames (T,), the meshes, and settings by name.

    settings: `rest_contacts` ("auto" or "repair"), `ignore` (pairs of names), `alone`, `clearance`,
    `cache` (whether to write the repaired meshes as a USD file as well).
    """

    command: str
    frames: tuple[int, ...]
    meshes: tuple[SampledMesh, ...]
    settings: Mapping[str, Any]


_ARRAYS = ("counts", "corners", "points", "matrices", "rest", "rest_matrix", "pin", "direction")


def write_request(folder: Path, request: Request) -> None:
    """Write a request into an empty folder."""
    arrays = {
        f"{index}.{name}": getattr(mesh, name)
        for index, mesh in enumerate(request.meshes)
        for name in _ARRAYS
        if getattr(mesh, name) is not None
    }
    np.savez(folder / "input.npz", **arrays)
    content = {
        "command": request.command,
        "frames": list(request.frames),
        "settings": dict(request.settings),
        "meshes": [{"name": mesh.name, "collider": mesh.collider} for mesh in request.meshes],
    }
    (folder / "request.json").write_text(json.dumps(content), encoding="utf-8")


def read_request(folder: Path) -> Request:
    """Read a request. Raises ValueError for a command that nobody knows."""
    content = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    if content["command"] not in COMMANDS:
        known = " or ".join(COMMANDS)
        raise ValueError(f"command: expected {known}, got {content['command']!r}")
    with np.load(folder / "input.npz") as arrays:
        meshes = tuple(
            SampledMesh(
                **mesh,
                **{n: arrays[f"{i}.{n}"] for n in _ARRAYS if f"{i}.{n}" in arrays.files},
            )
            for i, mesh in enumerate(content["meshes"])
        )
    return Request(content["command"], tuple(content["frames"]), meshes, content["settings"])


def write_arrays(path: Path, arrays: Mapping[str, Any]) -> None:
    """Write the arrays of a result."""
    np.savez(path, **arrays)


def read_pairs(path: Path, frames: int) -> list[NDArray[np.int32]]:
    """Return for each frame pairs (K, 4): mesh and polygon of one side, and of the other."""
    with np.load(path) as arrays:
        return [arrays[f"pairs.{frame}"] for frame in range(frames)]


def read_points(path: Path, meshes: Sequence[SampledMesh]) -> list[FloatArray]:
    """Return the repaired points (T, V, 3) of each mesh."""
    with np.load(path) as arrays:
        return [arrays[f"{index}.points"] for index in range(len(meshes))]
