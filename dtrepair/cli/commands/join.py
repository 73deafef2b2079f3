"""`dtrepair join`: merge the outputs of frame ranges into one layer."""

from __future__ import annotations

import os

import click

from dtrepair.cli.exit_codes import exit_codes
from dtrepair.cli.options.file_names import FILE
from dtrepair.cli.options.sections import Command
from dtrepair.cli.options.verbosity import console_options
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.failures import one_line_errors
from dtrepair.cli.terminal.outputs import already_written
from dtrepair.pipeline.errors import CLEAN, INPUT, OUTPUT
from dtrepair.wording import counted


@click.command("join", cls=Command, epilog=exit_codes(INPUT, OUTPUT, clean="written"))
@click.argument("chunks", type=FILE, metavar="CHUNK...", nargs=-1, required=True)
@click.option("-o", "--output", type=FILE, metavar="OUT", required=True, help="The layer to write.")
@click.option(
    "--skip-existing",
    is_flag=True,
    help="Do nothing if OUT is there already, joined of these layers, and none is newer.",
)
@console_options
@one_line_errors
def command(*, chunks: tuple[str, ...], output: str, skip_existing: bool, console: Console) -> int:
    """Merge layers that `repair --chunk` or `--frames` wrote over one input into one layer.

    A farm repairs ranges of one shot on several machines; stacking their layers would show one of
    them only, because the strongest layer with any time sample owns the whole attribute.

    \b
    Example:
        dtrepair repair shot.usd --chunk 1/2 -o part1.usdc
        dtrepair repair shot.usd --chunk 2/2 -o part2.usdc
        dtrepair join part1.usdc part2.usdc -o shot_repaired.usdc
    """
    from dtrepair.pipeline.join import check_joined, join_layers

    if skip_existing:
        check_joined(chunks, output)
        if already_written(output, console, inputs=chunks) is not None:
            return CLEAN
    older = os.path.isfile(output)
    join_layers(chunks, output)
    end = ", in place of an older one" if older else ""
    console.result(f"{output}: written from {counted(len(chunks), 'layer')}{end}")
    return CLEAN
