"""What a terminal sees of modelled contacts."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.command_line import OPEN, run, tube_obj
from tests.jointed_arm import FRAMES, arm_stage


def test_check_lists_the_pairs_of_parts_that_are_modelled(tmp_path: Path) -> None:
    path = arm_stage(tmp_path / "a.usda", np.linspace(0.0, 0.2, FRAMES))
    found = run("check", path, "--modelled")
    header, row, *rest = found.out.splitlines()
    assert header.split()[:5] == ["pairs", "in", "a", "frame", "as"]
    assert "bind pose" in row and "/Root/Arm part 1 (" in row and "with /Root/Arm part 2" in row
    report = run("check", path, "--json", "-").json
    at_rest, in_a_frame = (int(number) for number in row.split()[:2])
    assert at_rest == report["attached"]["listed"][0]["pairs"]
    assert in_a_frame == max(frame["before"]["modelled_pairs"] for frame in report["frames"])
    assert rest == run("check", path).out.splitlines()


def test_it_is_said_where_nothing_is_modelled(tmp_path: Path) -> None:
    found = run("check", tube_obj(tmp_path / "a.obj", OPEN), "--modelled")
    assert found.out.splitlines()[0] == "nothing is taken as modelled"
    assert found.code == 0
