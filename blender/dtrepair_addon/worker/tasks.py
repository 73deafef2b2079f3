"""Check and repair of a request, by `dtrepair.pipeline`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline import (
    ObjectOptions,
    Observer,
    PairsFound,
    Selection,
    check_stage,
    repair_stage,
)
from dtrepair.pipeline.observer import Remark
from dtrepair.repair.options import RepairOptions
from dtrepair.report.record import FrameRecord

from ..host.exchange import Request, write_arrays
from .main import tell
from .stage import DIRECTION, PIN, prim_paths, read_points, write_cache, write_stage

RESULT, CACHE = "result.npz", "cache.usdc"


class Lines(Observer):
    """Tells a run as lines of JSON; keeps the pairs that a check finds."""

    def __init__(self) -> None:
        self.pairs: dict[float | None, NDArray[np.int32]] = {}

    def start(self, phase: str, total: int) -> None:
        """Tell the phase and its frames."""
        tell("start", phase=phase, total=total)

    def advance(self, done: float) -> None:
        """Tell the frames done."""
        tell("advance", done=done)

    def warning(self, text: str) -> None:
        """Tell a warning."""
        tell("warning", text=text)

    def remark(self, remark: Remark) -> None:
        """Keep pairs."""
        if isinstance(remark, PairsFound):
            self.pairs[remark.time] = remark.pairs


def run(request: Request, folder: Path) -> dict[str, Any]:
    """Do what is asked; the arrays go to the folder, the rest comes back as plain values."""
    write_stage(request, folder / "scene.usdc")
    task = {"check": _check, "repair": _repair}[request.command]
    records = task(request, folder)
    return {
        "frames": [_plain(record) for record in records],
        "result": RESULT,
        "cache": CACHE,
        "prims": prim_paths(request),
    }


def _selection(request: Request) -> Selection:
    return Selection(frames=",".join(str(frame) for frame in request.frames))


def _ignored(request: Request) -> tuple[str, ...]:
    paths = dict(zip((m.name for m in request.meshes), prim_paths(request), strict=True))
    return tuple(f"{paths[a]},{paths[b]}" for a, b in request.settings.get("ignore", ()))


def _check(request: Request, folder: Path) -> tuple[FrameRecord, ...]:
    lines = Lines()
    report = check_stage(
        folder / "scene.usdc",
        selection=_selection(request),
        ignore=_ignored(request),
        rest_contacts=request.settings.get("rest_contacts", "auto"),
        observer=lines,
    )
    order = [prim.path for prim in report.prims]
    owner, polygon = _polygons(request, order)
    none = np.zeros((0, 2), np.int32)
    arrays = {}
    for index, frame in enumerate(request.frames):
        pairs = lines.pairs.get(float(frame), none)
        sides = [owner[pairs[:, 0]], polygon[pairs[:, 0]], owner[pairs[:, 1]], polygon[pairs[:, 1]]]
        arrays[f"pairs.{index}"] = np.unique(np.stack(sides, axis=1), axis=0).astype(np.int32)
    write_arrays(folder / RESULT, arrays)
    return report.frames


def _polygons(request: Request, order: list[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the mesh (F,) and polygon (F,) of each triangle of all meshes in a row."""
    paths = prim_paths(request)
    meshes = [paths.index(path) for path in order]
    fans = [request.meshes[mesh].counts - 2 for mesh in meshes]
    owner = np.repeat(meshes, [int(fan.sum()) for fan in fans])
    return owner, np.concatenate([np.repeat(np.arange(len(fan)), fan) for fan in fans])


def _repair(request: Request, folder: Path) -> tuple[FrameRecord, ...]:
    settings = request.settings
    paths = zip(request.meshes, prim_paths(request), strict=True)
    colliders = [path for mesh, path in paths if mesh.collider]
    report = repair_stage(
        folder / "scene.usdc",
        folder / "repaired.usdc",
        selection=_selection(request),
        options=RepairOptions(
            clearance=settings.get("clearance", 0.0),
            rest_contacts=settings.get("rest_contacts", "auto"),
        ),
        objects=ObjectOptions(
            collider=" ".join(colliders) or None,
            ignore=_ignored(request),
            pin=PIN if any(mesh.pin is not None for mesh in request.meshes) else None,
            direction=DIRECTION if any(m.direction is not None for m in request.meshes) else None,
        ),
        alone=settings.get("alone", False),
        observer=Lines(),
    )
    points = read_points(folder / "repaired.usdc", request)
    write_arrays(folder / RESULT, points)
    if settings.get("cache"):
        write_cache(request, points, folder / CACHE)
    return report.frames


def _plain(record: FrameRecord) -> dict[str, Any]:
    """What the host shows of a frame."""
    before, after = record.before, record.after
    return {
        "frame": record.time,
        "status": record.status,
        "message": record.message,
        "before": before.pairs if before is not None else None,
        "after": after.pairs if after is not None else None,
    }
