"""What a command says: results on stdout, warnings and remarks on stderr."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click


class Console:
    """Prints according to -q and -v."""

    def __init__(self, *, quiet: bool = False, verbosity: int = 0) -> None:
        """Choose what is printed: `quiet` nothing but errors, `verbosity` 1 each frame, 2 all."""
        self.quiet = quiet
        self.verbosity = verbosity
        self.results_on_stderr = False  # where stdout is kept for a report

    def result(self, text: str) -> None:
        """Print a result on stdout, or stderr where a report goes there, unless quiet."""
        if not self.quiet:
            click.echo(text, err=self.results_on_stderr)

    def table(self, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """Print aligned columns as results: the first to the left, the others to the right."""
        if self.quiet:
            return
        lines = [tuple(header), *(tuple(row) for row in rows)]
        widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
        for line in lines:
            cells = [line[0].ljust(widths[0])]
            cells += [cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True)]
            click.echo("  ".join(cells).rstrip(), err=self.results_on_stderr)

    def remark(self, text: str) -> None:
        """Print a line on stderr with -v."""
        if self.verbosity and not self.quiet:
            click.echo(text, err=True)

    def tell(self, text: str) -> None:
        """Print on stderr what every user should know, unless quiet."""
        if not self.quiet:
            click.echo(f"dtrepair: {text}", err=True)

    def trace(self, error: BaseException | None) -> None:
        """Print on stderr where an error comes from, with -vv."""
        if error is not None and self.verbosity > 1:
            import traceback

            self.remark("".join(traceback.format_exception(error)).rstrip())

    def warn(self, texts: Iterable[str]) -> None:
        """Print warnings on stderr, unless quiet."""
        if not self.quiet:
            for text in texts:
                click.echo(f"dtrepair: warning: {text}", err=True)
