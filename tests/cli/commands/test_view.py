"""`dtrepair view`: pictures without a display; the window where polyscope is installed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from dtrepair.cli.commands import view
from dtrepair.display import render, viewer
from dtrepair.display.viewer import Viewed
from dtrepair.pipeline.check import checked_scene
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.report.record import read_report
from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_obj, tube_stage
from tests.pipeline.repair.test_attached import BOTH, two_meshes
from tests.present import present


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")


def red_pixels(path: Path) -> NDArray[np.bool_]:
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    return (pixels[..., 0] > 100) & (pixels[..., 1] < 60) & (pixels[..., 2] < 60)


def pale_pixels(path: Path) -> NDArray[np.bool_]:
    with Image.open(path) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    # The background is bluish too, by two of 255.
    return np.asarray(pixels[..., 2] - pixels[..., 0] > 15)


def test_a_picture_of_before_and_after(tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    clean = tube_stage(tmp_path / "b.usda", (OPEN, OPEN, OPEN))
    picture = tmp_path / "p.png"
    done = run("view", clean, "--before", stage, "--screenshot", picture)
    assert done.code == 0 and done.err == "" and "written: " in done.out
    red = red_pixels(picture)
    assert red.shape[1] == 2 * 640
    # The worst frame of the input is taken, and only the input intersects there.
    assert red[:, :640].sum() > 50 and red[:, 640:].sum() == 0


def test_nothing_of_either_pose_is_cropped(tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "a.usda", (CLOSED,))
    long = tube_stage(tmp_path / "b.usda", (0.1,))  # unrolled it is much longer
    picture = tmp_path / "p.png"
    assert run("view", long, "--before", stage, "--screenshot", picture).code == 0
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB"))[:640]
    for half in (pixels[:, :640], pixels[:, 640:]):
        border = np.concatenate([half[0], half[-1], half[:, 0], half[:, -1]])
        assert (border == half[0, 0]).all() and (half != half[0, 0]).any()


def test_before_must_have_a_mesh_in_common(tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "a.usda", (OPEN,))
    other = tmp_path / "b.usda"
    other.write_text(stage.read_text().replace('"Tube"', '"Ring"'))
    picture = tmp_path / "p.png"
    done = run("view", stage, "--before", other, "--screenshot", picture)
    assert_fails(done, 2, f"--before {other}: has no mesh of {stage}", "expected /Root/Tube, got")
    assert "got /Root/Ring; name the input" in done.err and not picture.exists()
    # A mesh file is named by its file, which differs.
    meshes = [tube_obj(tmp_path / name, OPEN) for name in ("a.obj", "b.obj")]
    assert run("view", meshes[0], "--before", meshes[1], "--screenshot", picture).code == 0


def test_frames_choose_what_is_drawn(tmp_path: Path) -> None:
    stage = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    picture = tmp_path / "p.png"
    assert run("view", stage, "--screenshot", picture).code == 0
    assert red_pixels(picture).any()
    assert run("view", stage, "--screenshot", picture, "--frames", "3").code == 0
    assert not red_pixels(picture).any()


def test_a_mesh_file(tmp_path: Path) -> None:
    mesh = tube_obj(tmp_path / "a.obj", CLOSED)
    assert run("view", mesh, "--screenshot", tmp_path / "p.png").code == 0
    assert red_pixels(tmp_path / "p.png").any()


@pytest.mark.parametrize("options", [(), ("--attach", BOTH), ("--rest-contacts", "repair")])
def test_it_counts_as_check_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, options: tuple[str, ...]
) -> None:
    told: list[str] = []
    monkeypatch.setattr(
        render, "save_pictures", lambda path, images, *, captions: told.extend(captions)
    )
    rest = None if "--attach" in options else 1.9
    stage = two_meshes(tmp_path / "a.usda", rest=rest)
    report, screenshot = tmp_path / "r.json", tmp_path / "p.png"
    run("check", stage, *options, "--frames", "7", "--report", report)
    (frame,) = read_report(report)["frames"]
    counts = frame["before"]["triangles"], frame["before"]["modelled_triangles"]
    assert (counts[1] == 0) == ("repair" in options)
    done = run("view", stage, *options, "--frames", "7", "--screenshot", screenshot)
    assert done.code == 0
    modelled = f", {counts[1]} modelled" if counts[1] else ""
    assert told == [f"frame 7: {counts[0] or 'none'} intersecting{modelled}"]


def test_modelled_contacts_are_not_red(tmp_path: Path) -> None:
    stage, picture = two_meshes(tmp_path / "a.usda", rest=1.8), tmp_path / "p.png"
    assert run("view", stage, "--screenshot", picture).code == 0
    assert not red_pixels(picture).any() and pale_pixels(picture).any()
    # Where nothing intersects, the frame with most modelled contacts is taken.
    scene = checked_scene(open_source(str(stage), Selection()))
    assert scene.worst() == 6 and scene(7.0).counts[0] == 0 < scene(7.0).counts[1]


def test_errors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = tube_obj(tmp_path / "a.obj", CLOSED)
    picture = ("--screenshot", tmp_path / "p.png")
    monkeypatch.setattr(viewer, "has_polyscope", lambda: True)
    assert_fails(run("view", mesh), 2, "no display", "--screenshot")
    monkeypatch.setattr(viewer, "has_polyscope", lambda: False)
    assert_fails(run("view", mesh), 2, "pip install 'dtrepair[view]'")
    assert_fails(run("view", tmp_path / "no.obj", *picture), 3, "no.obj")
    assert_fails(run("view", mesh, "--screenshot", mesh), 2, "is an input")
    assert_fails(run("view", mesh, "--screenshot", tmp_path / "no" / "p.png"), 5, "written")
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert_fails(run("view", mesh, *picture), 2, "pip install pillow")


def test_pictures_are_png_or_jpg(tmp_path: Path) -> None:
    mesh = tube_obj(tmp_path / "a.obj", CLOSED)
    assert run("view", mesh, "--screenshot", tmp_path / "p.JPG").code == 0
    for name in ("v.txt", "v"):
        assert_fails(run("view", mesh, "--screenshot", tmp_path / name), 2, name, ".png")
        assert not (tmp_path / name).exists()


def test_an_unusable_frame_is_told(tmp_path: Path) -> None:
    from pxr import Usd

    path = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED))
    stage = Usd.Stage.Open(str(path))
    points = stage.GetPrimAtPath("/Root/Tube").GetAttribute("points")
    values = np.array(points.Get(2.0))
    values[0] = np.nan
    points.Set(values, 2.0)
    stage.GetRootLayer().Save()
    done = run("view", path, "--screenshot", tmp_path / "p.png", "--frames", "2")
    assert_fails(done, 3, "no frame is usable")
    assert run("view", path, "--screenshot", tmp_path / "p.png").code == 0


class FakeViewer:
    """Stands for the window: keeps what it was given."""

    made: FakeViewer | None = None

    def __init__(
        self,
        meshes: list[Viewed],
        labels: list[str],
        *,
        up: Any,
        first: int = 0,
        headless: bool = False,
        contacts: Callable[[int], list[str]],
    ) -> None:
        FakeViewer.made = self
        self.meshes, self.labels, self.first, self.up = meshes, labels, first, up
        self.contacts = contacts
        self.shown = False

    def show(self) -> None:
        self.shown = True

    def screenshot(self, path: Path) -> None:
        path.write_bytes(b"picture")


def test_the_window_gets_both_meshes_and_all_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "has_polyscope", lambda: True)
    monkeypatch.setattr(viewer, "Viewer", FakeViewer)
    assert run("view", stage, "--before", stage).code == 0
    made = present(FakeViewer.made)
    assert made.shown and made.labels == ["1", "2", "3"] and made.first == 0
    assert [mesh.name for mesh in made.meshes] == ["before", "after"]
    points, red, modelled = made.meshes[0].frame(1)
    assert len(points) == 200 and red.sum() > 0 and not modelled.any()
    assert not made.meshes[0].frame(0)[1].any()
    (line,) = made.contacts(1)
    assert line.startswith("/Root/Tube with itself: ") and line.endswith(" pairs")
    assert made.contacts(0) == []


def test_a_screenshot_of_the_window_shows_the_worst_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = tube_stage(tmp_path / "a.usda", (OPEN, CLOSED, OPEN))
    taken = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "has_polyscope", lambda: True)
    monkeypatch.setattr(viewer, "Viewer", FakeViewer)
    monkeypatch.setattr(FakeViewer, "screenshot", lambda self, path: taken.append(path))
    assert run("view", stage, "--screenshot", tmp_path / "p.png").code == 0
    assert taken == [str(tmp_path / "p.png")]
    made = present(FakeViewer.made)
    assert made.first == 1 and not made.shown


def test_a_broken_display_falls_back_to_a_drawing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object, **options: object) -> None:
        raise RuntimeError("no backend")

    mesh = tube_obj(tmp_path / "a.obj", CLOSED)
    monkeypatch.setenv("DISPLAY", ":77")
    monkeypatch.setattr(viewer, "has_polyscope", lambda: True)
    monkeypatch.setattr(viewer, "Viewer", broken)
    assert run("view", mesh, "--screenshot", tmp_path / "p.png").code == 0
    assert red_pixels(tmp_path / "p.png").any()
    assert_fails(run("view", mesh), 2, "cannot open a window", "--screenshot")


def test_summary_says_that_a_window_opens() -> None:
    assert "window" in present(view.command.help)
