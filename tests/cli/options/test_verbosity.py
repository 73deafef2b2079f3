"""-q and -v stand before the command or after it."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from dtrepair.cli.options.verbosity import console_options, verbosity_options
from dtrepair.cli.terminal.console import Console
from tests.command_line import run, tube_obj
from usd_io import StageError


@pytest.mark.parametrize(
    ("words", "quiet", "verbosity"),
    [
        ("go", False, 0),
        ("-q go", True, 0),
        ("go --quiet", True, 0),
        ("-v go", False, 1),
        ("go -v", False, 1),
        ("-v go -v", False, 2),
        ("--verbose -v go", False, 2),
        ("-q go -vv", True, 2),
    ],
)
def test_both_places_count(words: str, quiet: bool, verbosity: int) -> None:
    def above(**given: object) -> None: ...

    group = click.group()(verbosity_options(above))
    group.command("go")(console_options(lambda console: console))
    console = group.main(words.split(), standalone_mode=False)
    assert isinstance(console, Console)
    assert (console.quiet, console.verbosity) == (quiet, verbosity)


def test_the_program_has_them_in_both_places(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "a.obj")
    before, after = run("-q", "check", path), run("check", "-q", path)
    assert before == after and before.out == "" and before.code == 1
    with pytest.raises(StageError, match=r"none\.usd"):
        run("-v", "check", tmp_path / "none.usd", "-v")
