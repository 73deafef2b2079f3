"""What stands below the pictures of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.page import picture
from tests.command_line import OPEN, tube_stage


def test_a_clean_frame_is_called_before_and_after_only_where_there_is_an_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    below: list[str] = []

    def kept(path: Path, images: Any, *, captions: list[str], columns: int) -> None:
        below.extend(captions)

    monkeypatch.setattr(picture, "save_pictures", kept)
    stage = tube_stage(tmp_path / "a.usda", (OPEN, OPEN))
    for report in (check_stage(stage), repair_stage(stage, tmp_path / "b.usda")):
        picture.write_picture(report, tmp_path / "a.png")
    assert below == ["frame 1: no intersections", "frame 1, before, after: no intersections"]
