"""Rewriting a stage through the writer, and reading the points back, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usd_io import (
    AnimatedMesh,
    OverrideWriter,
    open_stage,
    read_frame,
    read_meshes,
)


def rewrite(
    path: Path, output: Path, times: Sequence[float] | None = None, **options: Any
) -> AnimatedMesh:
    """Write points + 1 at the given times (default: all) of every mesh; the first mesh."""
    opened = open_stage(path)
    selection = read_meshes(opened, **options)
    with OverrideWriter(opened, output, settings={"iterations": 60}) as writer:
        for mesh in selection.meshes:
            for time in mesh.times if times is None else times:
                points = read_frame(mesh, time)
                assert points is not None
                writer.write(mesh, time, points + np.float32(1.0))
        writer.commit()
    return selection.meshes[0]


def points_at(path: Path, time: float, prim: str = "/Root/Cube") -> NDArray[np.float32] | None:
    code = Usd.TimeCode.Default() if np.isnan(time) else time
    stage = Usd.Stage.Open(str(path))
    value = UsdGeom.Mesh(stage.GetPrimAtPath(prim)).GetPointsAttr().Get(code)
    return None if value is None else np.array(value)


def times_in(path: Path, name: str = "points", prim: str = "/Root/Cube") -> list[float]:
    stage = Usd.Stage.Open(str(path))
    return list(stage.GetPrimAtPath(prim).GetAttribute(name).GetTimeSamples())
