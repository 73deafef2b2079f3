"""What mypy is told: strict everywhere but in the Warp kernels, whose annotations are Warp's."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
MYPY: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]


def test_every_folder_of_python_is_checked_strictly() -> None:
    assert MYPY["strict"] is True
    assert set(MYPY["files"]) == {
        "dtrepair",
        "usd_io",
        "tests",
        "benchmarks",
        "examples",
        "blender",
        "docs",
    }


def test_only_warp_kernels_are_left_out() -> None:
    kernels = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in ROOT.glob("dtrepair/**/*.py")
        if "@wp.func" in (text := path.read_text()) or "@wp.kernel" in text
    }
    (override,) = MYPY["overrides"]
    assert override["ignore_errors"] and set(override["module"]) == kernels


def test_no_comment_turns_a_file_off() -> None:
    for folder in MYPY["files"]:
        for path in ROOT.glob(f"{folder}/**/*.py"):
            assert "# mypy:" + " ignore" not in path.read_text(), path
