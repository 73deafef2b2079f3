"""Intersecting triangles in red over the viewport, at the frames that were checked."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

RED = (1.0, 0.1, 0.05, 0.6)
# World corners (N, 3) of the triangles of each frame, three in a row for one.
_triangles: dict[int, NDArray[np.float32]] = {}
_handle: list[Any] = []


def show(triangles: dict[int, NDArray[np.float32]]) -> None:
    """Show triangles by their frames, instead of those shown before."""
    _triangles.clear()
    _triangles.update(triangles)
    if triangles and not _handle and not bpy.app.background:
        add = bpy.types.SpaceView3D.draw_handler_add
        _handle.append(add(_draw, (), "WINDOW", "POST_VIEW"))
    redraw()


def hide() -> None:
    """Show nothing."""
    _triangles.clear()
    while _handle:
        bpy.types.SpaceView3D.draw_handler_remove(_handle.pop(), "WINDOW")
    redraw()


def shown(frame: int) -> NDArray[np.float32]:
    """Return what is shown at a frame (N, 3)."""
    return _triangles.get(frame, np.zeros((0, 3), np.float32))


def redraw() -> None:
    """Ask all viewports to draw again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


def _draw() -> None:
    corners = shown(bpy.context.scene.frame_current)
    if not len(corners):
        return
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": corners})
    gpu.state.blend_set("ALPHA")
    # Over all, since what intersects lies inside.
    gpu.state.depth_test_set("NONE")
    shader.uniform_float("color", RED)
    batch.draw(shader)
    gpu.state.blend_set("NONE")
