"""The window's contents, drawn by polyscope without a display; skipped where it is missing."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.display.viewer import Viewed, Viewer, has_display
from tests.meshes import bent_tube

ANGLES = (5.0, 6.5)


def viewed(name: str) -> Viewed:
    faces = bent_tube(1.0)[1]

    def frame(index: int) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        return bent_tube(ANGLES[index])[0], np.arange(len(faces)) < 640 * index

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
        window._place(index)
        window.screenshot(tmp_path / "p.png")
        with Image.open(tmp_path / "p.png") as picture:
            pixels = np.asarray(picture.convert("RGB")).astype(int)
        red.append(((pixels[..., 0] > 1.5 * pixels[..., 1]) & (pixels[..., 0] > 60)).sum())
    assert red[0] == 0 and red[1] > 300
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.png"]


def test_the_slider_is_drawn(window: Viewer) -> None:
    import polyscope

    polyscope.set_user_callback(window._slider)
    polyscope.frame_tick()
    polyscope.clear_user_callback()
    assert window._index == 0
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
