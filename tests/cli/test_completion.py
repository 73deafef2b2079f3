"""What a shell is told when it completes a command line."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.shell_completion import BashComplete

from dtrepair.cli.app import COMMANDS, group
from dtrepair.cli.exit_codes import MEANINGS


def test_commands_are_completed_without_importing_them(monkeypatch: pytest.MonkeyPatch) -> None:
    def loaded(name: str) -> None:
        raise AssertionError(f"{name} was imported")

    monkeypatch.setattr(importlib, "import_module", loaded)
    items = group.shell_complete(click.Context(group), "re")
    assert [(item.value, item.help) for item in items] == [
        (name, COMMANDS[name]) for name in ("repair", "report")
    ]
    assert [item.value for item in group.shell_complete(click.Context(group), "")] == list(COMMANDS)


@pytest.mark.parametrize(
    ("words", "values"),
    [
        ("k", ["plain keyposes"]),
        ("--ver", ["plain --verbose", "plain --version"]),
        ("repair --cle", ["plain --clearance"]),
        ("repair shot.usd --method p", ["plain paper"]),
        ("repair sho", ["file sho"]),
        ("repair shot.usd -o sho", ["file sho"]),
        ("-q view shot.usd --before sho", ["file sho"]),
        ("transfer a.usd b.usd --markers c", ["file c"]),
    ],
)
def test_words_are_completed(words: str, values: list[str]) -> None:
    *before, last = words.split()
    found = BashComplete(group, {}, "dtrepair", "").get_completions(before, last)
    assert [f"{item.type} {item.value}" for item in found] == values


def test_shells_are_told_as_the_page_says() -> None:
    page = (Path(__file__).parents[2] / "docs" / "command_line.md").read_text(encoding="utf-8")
    asked = re.findall(r"_DTREPAIR_COMPLETE=(\w+) dtrepair", page)
    assert asked == ["bash_source", "zsh_source", "fish_source"]
    environment = {**os.environ, "_DTREPAIR_COMPLETE": asked[1]}
    done = subprocess.run(
        [sys.executable, "-m", "dtrepair"], env=environment, capture_output=True, check=True
    )
    assert b"#compdef dtrepair" in done.stdout


def test_the_page_has_the_exit_codes() -> None:
    page = (Path(__file__).parents[2] / "docs" / "command_line.md").read_text(encoding="utf-8")
    assert [int(code) for code in re.findall(r"^\| (\d+) \|", page, re.MULTILINE)] == list(MEANINGS)
