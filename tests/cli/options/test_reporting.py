"""`--report` and `--picture`: the same in every command that counts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dtrepair.pipeline.page.picture import PictureOptions
from dtrepair.report.schema import validate
from tests.command_line import CLOSED, OPEN, Outcome, assert_fails, run, tube_obj, tube_stage


def ran(folder: Path, command: str, *more: object) -> Outcome:
    """A run over two frames, of which the second intersects."""
    stage = tube_stage(folder / "a.usda", (OPEN, CLOSED))
    if command == "check":
        return run(command, stage, *more)
    target = [tube_obj(folder / "t.obj", OPEN)] if command == "transfer" else []
    return run(command, stage, *target, "-o", folder / "b.usdc", *more)


@pytest.mark.parametrize("command", ["repair", "keyposes"])
def test_a_page_at_once(tmp_path: Path, command: str) -> None:
    page = tmp_path / "r.html"
    assert ran(tmp_path, command, "--report", page).code == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith("<!doctype html>") and text.count("data:image/png") == 1
    assert "without pictures" not in text


@pytest.mark.parametrize(("command", "poses"), [("check", 1), ("repair", 2), ("transfer", 1)])
def test_a_picture_of_each_pose_there_is(tmp_path: Path, command: str, poses: int) -> None:
    picture = tmp_path / "p.png"
    assert ran(tmp_path, command, "--picture", picture).code in (0, 1)
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB")).astype(int)
    assert pixels.shape[1] == poses * PictureOptions().closeup.size
    red = (pixels[..., 0] > 100) & (pixels[..., 1] < 60)
    assert red.sum() > 20 and red[:, pixels.shape[1] // poses :].sum() == 0


def test_a_report_without_an_ending_is_json(tmp_path: Path) -> None:
    for name, option in (("r.json", "--report"), ("r", "--report"), ("j.json", "--json")):
        assert ran(tmp_path, "check", option, tmp_path / name).code == 1
        validate(json.loads((tmp_path / name).read_text()))


def test_where_nothing_intersects_the_whole_is_drawn(tmp_path: Path) -> None:
    picture = tmp_path / "p.jpg"
    path = tube_obj(tmp_path / "a.obj", OPEN)
    assert run("check", path, "--picture", picture).code == 0
    with Image.open(picture) as image:
        assert image.width == PictureOptions().closeup.size and np.ptp(np.asarray(image)) > 50


def test_places_are_checked_before_anything_is_computed(tmp_path: Path) -> None:
    wrong = (
        (("--picture", tmp_path / "p.tiff"), 2, "name the picture"),
        (("--picture", tmp_path / "no" / "p.png"), 5, "cannot be written"),
        (("--report", tmp_path / "no" / "r.html"), 5, "cannot be written"),
        (("--report", tmp_path / "a.usda"), 2, "is an input"),
        (("--report", tmp_path / "r.txt"), 2, "r.txt: name the report .json or .html, not .txt"),
    )
    for options, code, words in wrong:
        for command in ("check", "repair"):
            assert_fails(ran(tmp_path, command, *options), code, words)
    same = ("--picture", tmp_path / "p.png", "--report", tmp_path / "p.png")
    assert_fails(ran(tmp_path, "repair", *same), 2, "p.png")
    assert not (tmp_path / "b.usdc").exists()


def test_what_cannot_be_drawn_is_told_and_changes_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object, **__: object) -> None:
        raise ImportError("no Pillow")

    monkeypatch.setattr("dtrepair.pipeline.page.picture.save_pictures", fails)
    done = ran(tmp_path, "check", "--picture", tmp_path / "p.png")
    assert done.code == 1 and "p.png: not drawn: no Pillow" in done.err
    assert "1 of 2 frames intersects" in done.out
