"""An interactive window, or a picture of it, by polyscope; an optional package only named here."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.display.colours import Colours
from dtrepair.display.player import Player

# Frames that are kept: to go back to them, or play them again, counts nothing twice.
KEPT = 64
# How opaque the first mesh is where the others are laid over it.
OVERLAID = 0.4

Mask = NDArray[np.bool_]
Frame = tuple[NDArray[np.floating], Mask, Mask]


@dataclass(frozen=True)
class Viewed:
    """A mesh to look at: its name, triangles (F, 3), and its frames.

    frame: index of a frame -> points (V, 3), the mask (F,) of triangles drawn red, and that of
    those in modelled contacts only.
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
    """Meshes side by side or over one another, with a panel to go through their frames.

    labels: name of each frame. up: up axis (3,). headless: without a window, for pictures only.
    spacing: from one mesh to the next, in widths of the first. contacts: index of a frame -> lines
    that say what meets in the first mesh. rate: frames per second when it plays.

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
        contacts: Callable[[int], Sequence[str]] | None = None,
        rate: float = 24.0,
    ) -> None:
        self._spacing, self._colours = spacing, colours
        self._polyscope = _started(headless)
        self._names, self._faces = [m.name for m in meshes], [m.faces for m in meshes]
        self._frames = [lru_cache(KEPT)(mesh.frame) for mesh in meshes]
        self._labels = tuple(labels)
        self._contacts = lru_cache(KEPT)(contacts) if contacts is not None else None
        self._player = Player(len(labels), self._severity, first=first, rate=rate)
        self._overlaid = self._heat = self._smooth = False
        self._polyscope.set_up_dir("z_up" if np.asarray(up, dtype=np.float64)[2] > 0.5 else "y_up")
        self._polyscope.set_ground_plane_mode("shadow_only")
        self._structures: list[Any] = []
        self._place()
        self._polyscope.reset_camera_to_home_view()

    def show(self) -> None:
        """Open the window and return when it is closed."""
        self._polyscope.set_user_callback(self._panel)
        self._polyscope.show()
        self._polyscope.clear_user_callback()

    def screenshot(self, path: str | os.PathLike[str]) -> None:
        """Write what the window shows as a png, whole or not at all. Raises OSError."""
        from dtrepair.files.atomic import atomic_output

        with atomic_output(path) as temporary:
            self._polyscope.screenshot(os.fspath(temporary), transparent_bg=False)

    def _severity(self, index: int) -> int:
        """How many triangles of the first mesh intersect in a frame."""
        return int(np.count_nonzero(self._frames[0](index)[1]))

    @property
    def _comparable(self) -> bool:
        """Whether there are two meshes with the same vertices, so that moves can be shown."""
        sizes = {len(frame(self._player.index)[0]) for frame in self._frames}
        return len(self._frames) > 1 and len(sizes) == 1

    def _place(self) -> None:
        """Show the frame of the player: new points and colours."""
        frames = [frame(self._player.index) for frame in self._frames]
        width = float(np.ptp(frames[0][0][:, 0]))
        for column, (name, faces) in enumerate(zip(self._names, self._faces, strict=True)):
            points, red, modelled = frames[column]
            aside = 0.0 if self._overlaid else self._spacing * column * width
            placed = points + np.array([aside, 0.0, 0.0])
            if column == len(self._structures):
                self._structures.append(self._polyscope.register_surface_mesh(name, placed, faces))
            else:
                self._structures[column].update_vertex_positions(placed)
            structure = self._structures[column]
            colours = np.tile(np.asarray(self._colours.surface), (len(faces), 1))
            colours[modelled] = self._colours.modelled
            colours[red] = self._colours.intersecting
            heat = self._heat and column > 0 and self._comparable
            structure.add_color_quantity(
                "intersecting", colours, defined_on="faces", enabled=not heat
            )
            if heat:
                moved = np.linalg.norm(points - frames[0][0], axis=1)
                structure.add_scalar_quantity("moved", moved, enabled=True)
            structure.set_smooth_shade(self._smooth)
            structure.set_transparency(OVERLAID if self._overlaid and column == 0 else 1.0)

    def _panel(self) -> None:
        """Draw the controls, and do what they ask for."""
        imgui, player, changed = self._polyscope.imgui, self._player, False
        if player.count > 1:
            label = self._labels[player.index].replace("%", "%%")
            moved, index = imgui.SliderInt("time", player.index, 0, player.count - 1, label)
            changed |= moved and player.go(index)
            if imgui.Button("stop" if player.playing else "play"):
                player.play(not player.playing)
            imgui.SameLine()
            if imgui.Button("next worst frame"):
                player.play(False)
                changed |= player.next_worst()
            changed |= player.tick()
        if len(self._frames) > 1:
            overlaid, self._overlaid = imgui.Checkbox("one over the other", self._overlaid)
            changed |= overlaid
        if self._comparable:
            heat, self._heat = imgui.Checkbox("how far it moved", self._heat)
            changed |= heat
        smooth, self._smooth = imgui.Checkbox("smooth shading", self._smooth)
        if changed or smooth:
            self._place()
        if self._contacts is not None:
            lines = self._contacts(player.index)
            imgui.TextUnformatted("what intersects:" if lines else "nothing intersects")
            for line in lines:
                imgui.TextUnformatted(f"  {line}")


def _started(headless: bool) -> Any:
    """Return polyscope, ready and empty. Raises ImportError, RuntimeError."""
    try:
        import polyscope
    except ImportError:
        raise ImportError("the window needs polyscope: pip install 'dtrepair[view]'") from None
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
    polyscope.imgui.GetIO().IniSavingRate = 1e9
    polyscope.remove_all_structures()
    return polyscope
