"""What the README tells people to type is understood."""

from __future__ import annotations

import re
import shlex
import signal
import tomllib
from pathlib import Path
from typing import Any

import click
import pytest

from dtrepair import __all__ as names
from dtrepair.cli.app import COMMANDS, group
from dtrepair.pipeline import Cancelled, exit_code
from dtrepair.pipeline.errors import CANCELLED, INTERNAL, WORKERS
from tests.command_line import CLOSED, OPEN, read_samples, tube_stage

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
LINES = re.findall(r"^    (?:.* && venv/bin/)?(dtrepair .+)$", README, re.MULTILINE)


@pytest.mark.parametrize("line", LINES)
def test_commands_and_options_exist(line: str) -> None:
    name, *arguments = shlex.split(line, comments=True)[1:]
    assert name in COMMANDS
    command = group.get_command(click.Context(group), name)
    assert command is not None
    parsed = command.make_context(name, arguments)
    assert parsed.params


def test_every_command_and_exit_code_is_shown() -> None:
    assert {shlex.split(line)[1] for line in LINES} == set(COMMANDS)
    codes = {*range(WORKERS + 1), INTERNAL, CANCELLED, 128 + signal.SIGTERM}
    assert codes == {int(code) for code in re.findall(r"^\| (\d+) \|", README, re.MULTILINE)}


def test_python_names_are_public() -> None:
    used = set(re.findall(r"dtrepair\.(\w+)\(", README))
    assert used and used <= set(names)


def script() -> str:
    """The example of a host in the README, for the stage of the tests."""
    blocks = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    (block,) = (block for block in blocks if "repair_stage" in block)
    assert len([line for line in block.splitlines() if line]) <= 10
    return str(block).replace("/Hero//", "/Root//")


def test_a_stage_is_repaired_by_ten_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    tube_stage(tmp_path / "shot.usd", (OPEN, CLOSED))
    names: dict[str, Any] = {}
    exec(script(), names)
    assert exit_code(names["report"]) == 0 and len(names["report"].frames) == 2
    assert list(read_samples(tmp_path / "shot_repaired.usdc")) == [1.0, 2.0]
    assert "2.0 frames done" in capsys.readouterr().out


def test_the_ten_lines_are_cancelled_cleanly(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tube_stage(tmp_path / "shot.usd", (OPEN, CLOSED))
    (tmp_path / "shot_repaired.usdc").write_text("old")
    (tmp_path / "stop").touch()
    with pytest.raises(Cancelled):
        exec(script(), {})
    assert (tmp_path / "shot_repaired.usdc").read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 3


def test_files_that_are_named_exist() -> None:
    for target in re.findall(r"\]\(([\w/.]+)\)", README):
        assert (Path(__file__).parents[2] / target).is_file(), target


def test_installing_names_what_is_there() -> None:
    root = Path(__file__).parents[2]
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    lines = re.findall(r"^    .*pip install (.+?)(?: &&|$)", README, re.MULTILINE)
    assert len(lines) == 2
    for line in lines:
        words = shlex.split(line)
        assert (root / words[words.index("-c") + 1]).is_file()
        for extra in re.findall(r"\[(.+)\]", line):
            assert set(extra.split(",")) <= set(extras["optional-dependencies"])
