"""The group of commands, their lazy loading, and how a run ends."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from contextlib import suppress

import click
from click.shell_completion import CompletionItem

from dtrepair import __version__
from dtrepair.cli.exit_codes import MEANINGS, exit_codes
from dtrepair.cli.options.verbosity import verbosity_options
from dtrepair.cli.terminal.interrupts import Interrupts, exit_code, watched
from dtrepair.cli.terminal.streams import open_closed_streams, say, show_exception
from dtrepair.pipeline.errors import OUTPUT, PipelineError

# Name: summary. The module has the name of the command and holds a function `command`.
COMMANDS = {
    "demo": "Make a self-intersecting character, repair it, and show the result.",
    "check": "Count intersecting triangles, per prim and frame.",
    "repair": "Repair every selected frame and write a layer over the input, or a mesh file.",
    "keyposes": "Repair the keys of a stage only, and make the poses between them clean.",
    "transfer": "Give a mesh the motion of another one (deformation transfer).",
    "join": "Merge the layers of frame ranges (farm chunks) into one layer.",
    "report": "Make a self-contained HTML page of a JSON report.",
    "view": "Look at a stage or mesh, its intersecting triangles in red.",
}


class LazyGroup(click.Group):
    """A group whose commands are imported when they run; the list needs none of them."""

    def list_commands(self, context: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, context: click.Context, name: str) -> click.Command | None:
        """Import the module of a command."""
        if name not in COMMANDS:
            return None
        module = importlib.import_module(f"dtrepair.cli.commands.{name}")
        command: click.Command = module.command
        return command

    def resolve_command(
        self, context: click.Context, arguments: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command; of an unknown one tell which may be meant."""
        name = arguments[0]
        if name not in COMMANDS and name[:1].isalpha() and not context.resilient_parsing:
            from difflib import get_close_matches

            near = get_close_matches(name.lower(), COMMANDS, n=1)
            meant = f" (did you mean {near[0]}?)" if near else ""
            context.fail(f"no such command: {name}{meant}")
        return super().resolve_command(context, arguments)

    def shell_complete(self, context: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete names of commands without importing any."""
        if not incomplete[:1].isalnum() and incomplete:
            return super().shell_complete(context, incomplete)
        return [
            CompletionItem(name, help=summary)
            for name, summary in COMMANDS.items()
            if name.startswith(incomplete)
        ]

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write names and summaries without importing anything."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    epilog=exit_codes(*MEANINGS),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@verbosity_options
@click.version_option(__version__, prog_name="dtrepair", message="%(prog)s %(version)s")
def group(**verbosity: object) -> None:
    """Find and repair self-intersections of meshes and animated characters.

    Works on USD stages (usd, usda, usdc, usdz) and mesh files (obj, ply, off, stl, glb).

    \b
    Example:
        dtrepair check shot.usd --prim "/Hero//"
        dtrepair repair shot.usd --prim "/Hero//" -o shot_repaired.usdc
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code; an error is one line on stderr."""
    open_closed_streams()
    sys.excepthook = show_exception
    given = list(sys.argv[1:] if arguments is None else arguments)
    # Threads of numpy's products only wait here, at full load; it reads this when it is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Where a binary layer is mapped into memory, an input that is cut short kills the process.
    os.environ.setdefault("USDC_USE_PREAD", "1")
    with watched() as interrupts:
        code = _run(given or ["--help"], interrupts)
    sys.exit(code if isinstance(code, int) else 0)


def _run(arguments: list[str], interrupts: Interrupts) -> object:
    """The exit code of a run; errors are told."""
    try:
        return group.main(
            args=arguments, prog_name="dtrepair", standalone_mode=False, obj=interrupts
        )
    except click.exceptions.Exit as done:
        return done.exit_code
    except click.UsageError as error:
        context = error.ctx.command_path if error.ctx else "dtrepair"
        parameter = error.param if isinstance(error, click.BadParameter) else None
        # What is wrong in a file is told whole.
        in_file = parameter is not None and parameter.name == "config"
        hint = "" if in_file else f"; see {context} --help"
        _complain(f"{error.format_message().rstrip('.')}{hint}")
        return error.exit_code
    except PipelineError as error:
        _complain(str(error))
        return error.exit_code
    except click.ClickException as error:
        _complain(error.format_message())
        return error.exit_code
    except (KeyboardInterrupt, click.Abort) as error:
        interrupts.say()
        return exit_code(error.__context__ or error)
    except OSError as error:  # of a help text, which click prints itself
        with suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader has gone (`| head`)
            return 0
        _complain(f"standard output: cannot be written: {error.strerror}")
        return OUTPUT


def _complain(message: str) -> None:
    say(f"dtrepair: error: {' '.join(message.split())}", err=True)
