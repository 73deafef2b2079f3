"""An input that another program cuts short while it is read."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import CLOSED, OPEN, tube_stage
from usd_io import OverrideWriter, StageError, open_stage, read_frame, read_meshes

# Runs the program; the input is cut after it was opened, before its frames are read.
PROGRAM = """
import os, sys
from dtrepair.cli import main
from dtrepair.pipeline.stages import frames

counter = frames.make_counter
def cut(source, **options):
    os.truncate(source.name, 2000)
    return counter(source, **options)

import dtrepair.pipeline.check, dtrepair.pipeline.stages.rest
dtrepair.pipeline.check.make_counter = cut
dtrepair.pipeline.stages.rest.make_counter = cut
main(sys.argv[1:])
"""


@pytest.mark.parametrize("command", ["check", "repair"])
def test_it_is_an_error_of_the_input_and_leaves_nothing(tmp_path: Path, command: str) -> None:
    path = tube_stage(tmp_path / "in.usdc", [OPEN, CLOSED] * 6, rest=None)
    out = [] if command == "check" else ["-o", str(tmp_path / "out.usdc")]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, command, str(path), *out],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        timeout=100,
        check=False,
    )
    assert done.returncode == 3, done
    lines = [line for line in done.stderr.splitlines() if "warning" not in line]
    assert len(lines) == 1 and "in.usdc: was changed while it was read, from" in lines[0]
    assert os.listdir(tmp_path) == ["in.usdc"]


def test_a_writer_commits_nothing_over_a_file_that_grew(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "in.usda", [OPEN, CLOSED])
    opened = open_stage(path)
    mesh = read_meshes(opened).meshes[0]
    points = read_frame(mesh, 1.0)
    assert points is not None
    with OverrideWriter(opened, tmp_path / "out.usda", settings={}) as writer:
        writer.write(mesh, 1.0, points)
        with open(path, "a") as file:
            file.write("\n")
        with pytest.raises(StageError, match=r"in\.usda: was changed while it was read, from"):
            writer.commit()
    assert os.listdir(tmp_path) == ["in.usda"]


def test_a_file_that_another_one_replaces_is_read_on(tmp_path: Path) -> None:
    path = tube_stage(tmp_path / "in.usdc", [OPEN, CLOSED])
    opened = open_stage(path)
    os.replace(tube_stage(tmp_path / "new.usdc", [OPEN]), path)
    opened.check_unchanged()
