"""Options stand under headings, and every command tells what it may end with."""

from __future__ import annotations

import click
import pytest

from dtrepair.cli.app import COMMANDS, group
from dtrepair.cli.exit_codes import MEANINGS, exit_codes
from dtrepair.cli.options.sections import OTHER, SECTIONS, Command, heading_of
from dtrepair.pipeline.errors import WORKERS
from tests.command_line import run
from tests.present import present


def options(name: str) -> list[click.Option]:
    """The options of a command, as its help lists them."""
    context = click.Context(group)
    command = present(group.get_command(context, name))
    own = command.get_params(click.Context(command, info_name=name))
    return [option for option in own if isinstance(option, click.Option)]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_a_heading_and_help_shows_it(name: str) -> None:
    assert not [own.opts for own in options(name) if heading_of(own) == OTHER]
    shown = run(name, "--help").out
    found = [heading for heading in SECTIONS if f"\n{heading}:\n" in shown]
    assert set(found) == {heading_of(own) for own in options(name)}
    assert found == sorted(found, key=lambda heading: shown.index(f"\n{heading}:\n"))


def test_headings_name_only_options_that_exist() -> None:
    known = {own.name for name in COMMANDS for own in options(name)} | {"help"}
    listed = [name for names in SECTIONS.values() for name in names.split()]
    assert len(listed) == len(set(listed)) and set(listed) <= known


def test_an_option_without_a_heading_is_listed_all_the_same() -> None:
    command = Command("x", params=[click.Option(["--strange"], help="Odd.")])
    shown = command.get_help(click.Context(command, info_name="x"))
    assert "Other:\n  --strange TEXT  Odd." in shown and "Running:\n  --help" in shown


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_tells_how_a_run_may_end(name: str) -> None:
    shown = " ".join(run(*name.split(), "--help").out.split())
    ends = shown[shown.index("Exit codes: 0 ") :]
    for code in (2, 70, 130, 143):
        assert f"; {code} {MEANINGS[code]}" in ends
    if not name:
        assert all(f" {code} {meaning}" in ends for code, meaning in MEANINGS.items())


def test_a_command_may_have_its_own_words() -> None:
    told = exit_codes(WORKERS, clean="well")
    assert told.startswith("Exit codes: 0 well; 2 ") and f"7 {MEANINGS[WORKERS]}; 70" in told
