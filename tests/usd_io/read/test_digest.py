"""The digest of the files of a stage."""

from __future__ import annotations

import shutil
from pathlib import Path

from pxr import Usd

from tests.usd_stages import cube_file
from usd_io import input_digest, open_stage


def test_the_content_counts_not_the_place(tmp_path: Path) -> None:
    for name in ("here", "there"):
        (tmp_path / name).mkdir()
    cube_file(tmp_path / "here" / "cube.usdc", times=[1.0, 2.0])
    (tmp_path / "here" / "shot.usda").write_text("#usda 1.0\n( subLayers = [@./cube.usdc@] )\n")
    for name in ("cube.usdc", "shot.usda"):
        shutil.copy(tmp_path / "here" / name, tmp_path / "there" / name)
    here, there = (open_stage(tmp_path / name / "shot.usda") for name in ("here", "there"))
    digest = input_digest(here)
    assert len(digest) == 64 and digest == input_digest(there)
    assert digest != input_digest(open_stage(tmp_path / "here" / "cube.usdc"))
    del there
    cube_file(tmp_path / "there" / "other.usdc", times=[1.0, 3.0])
    (tmp_path / "there" / "other.usdc").replace(tmp_path / "there" / "cube.usdc")
    assert digest != input_digest(open_stage(tmp_path / "there" / "shot.usda"))


def test_a_stage_in_memory_has_no_files() -> None:
    assert len(input_digest(Usd.Stage.CreateInMemory())) == 64
