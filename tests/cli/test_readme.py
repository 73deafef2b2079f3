"""What the README tells people to type is understood."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import click
import pytest

from dtrepair import __all__ as names
from dtrepair.cli.app import COMMANDS, group

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
LINES = re.findall(r"^    (?:.* && venv/bin/)?(dtrepair .+)$", README, re.MULTILINE)


@pytest.mark.parametrize("line", LINES)
def test_commands_and_options_exist(line: str) -> None:
    name, *arguments = shlex.split(line)[1:]
    assert name in COMMANDS
    command = group.get_command(click.Context(group), name)
    assert command is not None
    parsed = command.make_context(name, arguments)
    assert parsed.params


def test_every_command_and_exit_code_is_shown() -> None:
    assert {shlex.split(line)[1] for line in LINES} == set(COMMANDS)
    for code in range(6):
        assert f"\n| {code} |" in README


def test_python_names_are_public() -> None:
    used = set(re.findall(r"dtrepair\.(\w+)\(", README))
    assert used and used <= set(names)


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
