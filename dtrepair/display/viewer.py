"""An interactive window, or a picture of it, by polyscope; an optional package only named here."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.display.colours import Colours

Frame = tuple[NDArray[np.floating], NDArray[np.bool_]]


@dataclass(frozen=True)
class Viewed:
    """A mesh to look at: its name, triangles (F, 3), and its frames.

    frame: index of a frame -> points (V, 3) and the mask (F,) of triangles drawn red.
    """

    name: str
    faces: NDArray[np.int32]
    frame: Callable[[int], Frame]


def has_polyscope() -> bool:
    """Return whether the optional package is installed."""
    from importlib.util import find_spec

    return find_spec("polyscope") is not None


def has_display() -> bool:
    """Return whether there is a screen to open a window on."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


class Viewer:
    """Meshes side by side, with a slider over their frames.

    labels: name of each frame. up: up axis (3,). headless: without a window, for pictures only.
    spacing: from one mesh to the next, in widths of the first.

    Raises:
        ImportError: polyscope is not installed; with the cure.
        RuntimeError: no window and no headless picture can be made here.
    """

    def __init__(
        self,
        meshes: Sequence[Viewed],
        labels: Sequence[str],
        *,
        up: ArrayLike = (0.0, 1.0, 0.0),
        first: int = 0,
        headless: bool = False,
        spacing: float = 1.15,
        colours: Colours = Colours(),
    ) -> None:
        self._spacing, self._colours = spacing, colours
        try:
            import polyscope
        except ImportError:
            raise ImportError("the window needs polyscope: pip install 'dtrepair[view]'") from None
        self._polyscope: Any = polyscope
        self._meshes, self._labels = tuple(meshes), tuple(labels)
        polyscope.set_verbosity(0)
        polyscope.set_program_name("dtrepair")
        polyscope.set_use_prefs_file(False)
        if headless:
            polyscope.set_allow_headless_backends(True)
        try:
            polyscope.init("openGL3_egl" if headless else "auto")
        except RuntimeError:
            # Its handler at exit complains about a polyscope that was never initialised.
            polyscope.init("openGL_mock")
            raise
        # Seconds: no imgui.ini in the user's folder.
        self._polyscope.imgui.GetIO().IniSavingRate = 1e9
        polyscope.remove_all_structures()
        polyscope.set_up_dir("z_up" if np.asarray(up, dtype=np.float64)[2] > 0.5 else "y_up")
        polyscope.set_ground_plane_mode("shadow_only")
        self._index = first
        self._structures: list[Any] = []
        self._place(first)
        polyscope.reset_camera_to_home_view()

    def show(self) -> None:
        """Open the window and return when it is closed."""
        self._polyscope.set_user_callback(self._slider)
        self._polyscope.show()
        self._polyscope.clear_user_callback()

    def screenshot(self, path: str | os.PathLike[str]) -> None:
        """Write what the window shows as a png, whole or not at all. Raises OSError."""
        from dtrepair.files.atomic import atomic_output

        with atomic_output(path) as temporary:
            self._polyscope.screenshot(os.fspath(temporary), transparent_bg=False)

    def _place(self, index: int) -> None:
        """Show a frame: new points and colours."""
        frames = [mesh.frame(index) for mesh in self._meshes]
        width = float(np.ptp(frames[0][0][:, 0]))
        for column, (mesh, (points, red)) in enumerate(zip(self._meshes, frames, strict=True)):
            placed = points + np.array([self._spacing * column * width, 0.0, 0.0])
            if column == len(self._structures):
                self._structures.append(
                    self._polyscope.register_surface_mesh(mesh.name, placed, mesh.faces)
                )
            else:
                self._structures[column].update_vertex_positions(placed)
            colours = np.where(
                np.asarray(red)[:, None], self._colours.intersecting, self._colours.surface
            )
            self._structures[column].add_color_quantity(
                "intersecting", colours, defined_on="faces", enabled=True
            )

    def _slider(self) -> None:
        if len(self._labels) < 2:
            return
        imgui = self._polyscope.imgui
        changed, index = imgui.SliderInt("frame", self._index, 0, len(self._labels) - 1)
        imgui.TextUnformatted(f"time {self._labels[index]}")
        if changed:
            self._index = index
            self._place(index)
