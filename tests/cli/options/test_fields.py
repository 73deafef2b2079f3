"""Options of the command line that are fields of a dataclass."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import click
import pytest
from click.testing import CliRunner

from dtrepair.cli.app import COMMANDS, group
from dtrepair.cli.options.fields import as_object, default_of, expression_option
from dtrepair.keyposes.options import KeyOptions
from dtrepair.pipeline.check_settings import CheckSettings
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import ObjectOptions, Selection
from dtrepair.pipeline.transfer.options import TransferOptions
from dtrepair.repair.options import RepairOptions


def command(*, seen: list[RepairOptions]) -> click.Command:
    """A command with two options of the method."""

    def function(options: RepairOptions) -> None:
        seen.append(options)

    chosen: dict[str, dict[str, Any]] = {"tighten": {"type": int}, "skip": {"flag": "--without"}}
    return click.command()(as_object(RepairOptions, "options", chosen)(function))


def test_values_reach_the_command_as_one_object() -> None:
    seen: list[RepairOptions] = []
    made = command(seen=seen)
    for arguments in ([], ["--tighten", "1", "--without", "fill", "--without", "relax"]):
        CliRunner().invoke(made, arguments, catch_exceptions=False)
    assert seen == [RepairOptions(), RepairOptions(tighten=1, skip=("fill", "relax"))]


def test_a_choice_that_cannot_be_is_named_as_on_the_command_line() -> None:
    with pytest.raises(UsageError, match=r"^--tighten should be at least 0, got -1$"):
        command(seen=[]).main(["--tighten", "-1"], standalone_mode=False)


def test_several_path_expressions_are_one() -> None:
    seen: list[Selection] = []

    def function(selection: Selection) -> None:
        seen.append(selection)

    chosen = {"prim": expression_option("Meshes.")}
    made = click.command()(as_object(Selection, "selection", chosen)(function))
    for arguments in ([], ["--prim", "/A - /A/B"], ["--prim", "/A - /A/B", "--prim", "/C"]):
        CliRunner().invoke(made, arguments, catch_exceptions=False)
    assert [own.prim for own in seen] == [None, "/A - /A/B", "(/A - /A/B) + (/C)"]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_path_expression_may_be_given_several_times(name: str) -> None:
    made = group.get_command(click.Context(group), name)
    assert made is not None
    options = [own for own in made.params if isinstance(own, click.Option)]
    assert all(own.multiple for own in options if own.metavar == "EXPR")


@pytest.mark.parametrize("name", COMMANDS)
def test_defaults_are_those_of_the_dataclasses(name: str) -> None:
    made = group.get_command(click.Context(group), name)
    assert made is not None
    kinds: tuple[type, ...] = (Selection, ObjectOptions, TransferOptions, KeyOptions, RepairOptions)
    if name in ("check", "view"):  # choose how contacts are counted, not what is done with them
        kinds = (CheckSettings, *kinds)
    homes = {field.name: kind for kind in reversed(kinds) for field in fields(kind)}
    for option in made.params:
        if option.name in homes and isinstance(option, click.Option):
            assert option.default == default_of(homes[option.name], option.name), option.name
