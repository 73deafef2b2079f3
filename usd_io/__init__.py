"""Animated meshes out of a USD stage, and repaired points back into a layer over it.

    opened = usd_io.open_stage("shot.usd")
    selection = usd_io.read_meshes(opened)
    with usd_io.OverrideWriter(opened, "fixed.usdc", settings={}) as writer:
        for mesh in selection.meshes:
            for time in mesh.times:
                writer.write(mesh, time, repaired(usd_io.read_frame(mesh, time)))
        writer.commit()

Plain numpy arrays come out and go in. The names load pxr on first use.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from usd_io.errors import (
        FrameError,
        FrameSpecError,
        OutputError,
        SelectionError,
        StageError,
        UsageError,
        UsdIoError,
    )
    from usd_io.read.matrices import inverse_matrix, transform_points
    from usd_io.read.mesh import AnimatedMesh, MeshSelection
    from usd_io.read.reader import read_frame, read_meshes, read_points
    from usd_io.read.stage_times import StageTimes, key_times, stage_times
    from usd_io.read.stages import OpenedStage, input_digest, open_stage
    from usd_io.read.transforms import (
        WorldMatrices,
        local_points,
        transform_times,
        world_faces,
        world_matrix,
    )
    from usd_io.read.vertex_weights import read_vertex_weights
    from usd_io.times import FrameSpec, parse_frames
    from usd_io.write.authoring import AuthoredMesh, write_animation
    from usd_io.write.joining import is_joined, join_layers
    from usd_io.write.records import repair_settings, repaired_stage
    from usd_io.write.writer import OverrideWriter

__all__ = [
    "AnimatedMesh",
    "AuthoredMesh",
    "FrameError",
    "FrameSpec",
    "FrameSpecError",
    "MeshSelection",
    "OpenedStage",
    "OutputError",
    "OverrideWriter",
    "SelectionError",
    "StageError",
    "StageTimes",
    "UsageError",
    "UsdIoError",
    "WorldMatrices",
    "input_digest",
    "inverse_matrix",
    "is_joined",
    "join_layers",
    "key_times",
    "local_points",
    "open_stage",
    "parse_frames",
    "read_frame",
    "read_meshes",
    "read_points",
    "read_vertex_weights",
    "repair_settings",
    "repaired_stage",
    "stage_times",
    "transform_points",
    "transform_times",
    "world_faces",
    "world_matrix",
    "write_animation",
]

_MODULES = {
    "write.authoring": ("AuthoredMesh", "write_animation"),
    "errors": (
        "FrameError",
        "FrameSpecError",
        "OutputError",
        "SelectionError",
        "StageError",
        "UsageError",
        "UsdIoError",
    ),
    "write.joining": ("is_joined", "join_layers"),
    "read.matrices": ("inverse_matrix", "transform_points"),
    "read.mesh": ("AnimatedMesh", "MeshSelection"),
    "read.reader": ("read_frame", "read_meshes", "read_points"),
    "read.stage_times": ("StageTimes", "key_times", "stage_times"),
    "read.stages": ("OpenedStage", "input_digest", "open_stage"),
    "times": ("FrameSpec", "parse_frames"),
    "read.transforms": (
        "WorldMatrices",
        "local_points",
        "transform_times",
        "world_faces",
        "world_matrix",
    ),
    "read.vertex_weights": ("read_vertex_weights",),
    "write.records": ("repair_settings", "repaired_stage"),
    "write.writer": ("OverrideWriter",),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'usd_io' has no attribute {name!r}")
    # Kept, as the next one would look it up again: functions are called once for each small mesh.
    value = globals()[name] = getattr(importlib.import_module(f"usd_io.{_HOME[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
