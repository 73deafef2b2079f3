"""The window's contents, drawn by polyscope without a display; skipped where it is missing."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.colours import Colours
from dtrepair.display.viewer import Viewed, Viewer, has_display
from tests.meshes import bent_tube

ANGLES = (5.0, 6.5)


Shown = tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]


def viewed(name: str) -> Viewed:
    faces = bent_tube(1.0)[1]

    def frame(index: int) -> Shown:
        red = np.arange(len(faces)) < 640 * index
        return bent_tube(ANGLES[index])[0], red, np.arange(len(faces)) < 10

    return Viewed(name, faces, frame)


@pytest.fixture
def window() -> Viewer:
    pytest.importorskip("polyscope")
    try:
        return Viewer([viewed("before"), viewed("after")], ["1", "2"], headless=True)
    except RuntimeError:
        pytest.skip("no headless pictures here")


def test_a_picture_follows_the_frame(window: Viewer, tmp_path: Path) -> None:
    from PIL import Image

    red = []
    for index in (0, 1):
        window._player.go(index)
        window._place()
        window.screenshot(tmp_path / "p.png")
        with Image.open(tmp_path / "p.png") as picture:
            pixels = np.asarray(picture.convert("RGB")).astype(int)
        red.append(((pixels[..., 0] > 1.5 * pixels[..., 1]) & (pixels[..., 0] > 60)).sum())
    assert red[0] == 0 and red[1] > 300
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.png"]


def test_the_panel_is_drawn(window: Viewer) -> None:
    import polyscope

    polyscope.set_user_callback(window._panel)
    polyscope.frame_tick()
    polyscope.clear_user_callback()
    assert window._player.index == 0
    assert polyscope.imgui.GetIO().IniSavingRate > 1e8


def test_without_polyscope_the_cure_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "polyscope", None)
    with pytest.raises(ImportError, match=r"pip install 'dtrepair\[view\]'"):
        Viewer([viewed("one")], ["1"])


def test_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    assert not has_display()
    monkeypatch.setenv("WAYLAND_DISPLAY", "wayland-0")
    assert has_display()
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.delenv("WAYLAND_DISPLAY")
    assert has_display()


class Recorded:
    """A mesh of a window that keeps what it is told."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        self.points, self.enabled, self.smooth, self.opaque = points, "", False, 1.0
        self.moved: NDArray[np.float64] | None = None
        self.colours: NDArray[np.float64] | None = None

    def update_vertex_positions(self, points: NDArray[np.float64]) -> None:
        self.points = points

    def add_color_quantity(self, name: str, values: Any, *, defined_on: str, enabled: bool) -> None:
        assert defined_on == "faces"
        self.enabled, self.colours = name if enabled else self.enabled, values

    def add_scalar_quantity(self, name: str, values: Any, *, enabled: bool) -> None:
        self.enabled, self.moved = name, values

    def set_smooth_shade(self, smooth: bool) -> None:
        self.smooth = smooth

    def set_transparency(self, opaque: float) -> None:
        self.opaque = opaque


class Scripted:
    """Stands for imgui: what is in `answers` is clicked or changed; labels and texts are kept."""

    def __init__(self) -> None:
        self.answers: dict[str, Any] = {}
        self.seen: list[str] = []

    def __getattr__(self, name: str) -> Any:
        def control(label: str = "", *values: Any) -> Any:
            self.seen.append(" ".join([label, *(v for v in values if isinstance(v, str))]))
            if name == "Button":
                return label in self.answers
            return label in self.answers, self.answers.get(label, values[0] if values else None)

        return control


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> tuple[Viewer, Scripted]:
    """A window of before and after, of a polyscope that is none."""
    fake: Any = MagicMock()
    fake.imgui = Scripted()
    fake.imgui.GetIO = MagicMock()
    fake.register_surface_mesh = lambda name, points, faces: Recorded(points)
    monkeypatch.setitem(sys.modules, "polyscope", fake)
    meshes = [viewed("before"), replace(viewed("after"), frame=moved_aside)]
    window = Viewer(meshes, ["1", "50 %"], contacts=lambda index: ["/A: 3 pairs"] * index)
    return window, fake.imgui


def moved_aside(index: int) -> Shown:
    points, red, modelled = viewed("before").frame(index)
    return points + np.array([0.0, 0.25, 0.0]), np.zeros_like(red), modelled


def pressed(window: Viewer, imgui: Scripted, **answers: Any) -> list[str]:
    """What the panel shows when some of its controls are used."""
    imgui.answers = {name.replace("_", " "): value for name, value in answers.items()}
    imgui.seen = []
    window._panel()
    return imgui.seen


def test_the_slider_shows_time_codes_and_chooses_a_frame(
    scripted: tuple[Viewer, Scripted],
) -> None:
    window, imgui = scripted
    assert "time 1" in pressed(window, imgui, time=1)
    assert window._player.index == 1
    assert np.array_equal(window._structures[0].points, viewed("before").frame(1)[0])
    seen = pressed(window, imgui)
    assert "time 50 %%" in seen and "what intersects:" in seen and "  /A: 3 pairs" in seen
    pressed(window, imgui, time=0)
    assert "nothing intersects" in pressed(window, imgui)


def test_modelled_contacts_have_a_colour_of_their_own(scripted: tuple[Viewer, Scripted]) -> None:
    window, imgui = scripted
    shown, colours = window._structures[0], Colours()
    assert (shown.colours[:10] == colours.modelled).all()
    assert (shown.colours[10:] == colours.surface).all()
    pressed(window, imgui, time=1)
    assert (shown.colours[:640] == colours.intersecting).all()


def test_buttons_play_and_go_to_the_worst_frame(scripted: tuple[Viewer, Scripted]) -> None:
    window, imgui = scripted
    pressed(window, imgui, play=True)
    assert window._player.playing and "stop" in pressed(window, imgui)
    pressed(window, imgui, next_worst_frame=True)
    assert window._player.index == 1 and not window._player.playing


def test_one_is_laid_over_the_other(scripted: tuple[Viewer, Scripted]) -> None:
    window, imgui = scripted
    first, second = window._structures
    assert second.points[:, 0].min() > first.points[:, 0].max()
    pressed(window, imgui, one_over_the_other=True)
    assert np.allclose(second.points - first.points, [0.0, 0.25, 0.0])
    assert first.opaque < 1.0 == second.opaque


def test_moves_are_coloured_and_shading_is_smooth(scripted: tuple[Viewer, Scripted]) -> None:
    window, imgui = scripted
    first, second = window._structures
    assert (first.enabled, second.enabled) == ("intersecting", "intersecting")
    pressed(window, imgui, how_far_it_moved=True)
    assert (first.enabled, second.enabled) == ("intersecting", "moved")
    assert np.allclose(second.moved, 0.25)
    pressed(window, imgui, smooth_shading=True)
    assert first.smooth and second.smooth
    pressed(window, imgui, how_far_it_moved=False)
    assert second.enabled == "intersecting"
