"""What a command says: results on stdout, warnings and remarks on stderr."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from dtrepair.cli.terminal.streams import say, shown_line
from dtrepair.pipeline.errors import OutputError

# So many rows in a row that say the same become one.
FOLDED = 3


def folded(
    rows: Sequence[tuple[str, str, tuple[str, ...]]], *, each: str = "", fold: bool = True
) -> list[list[str]]:
    """Return rows of which runs that say the same are one row: from its first to its last.

    rows: what a row begins and ends with, such as a frame, and its other cells. each: what the name
    of such a run ends with, {} its number of rows. fold: without it every row stays.
    """
    found: list[list[str]] = []
    for cells, run in groupby(rows, key=lambda row: row[2]):
        same = list(run)
        if fold and len(same) >= FOLDED:
            same = [(same[0][0], f"{same[-1][1]}{each.format(len(same))}", cells)]
        found += [
            [start if start == end else f"{start} to {end}", *cells] for start, end, _ in same
        ]
    return found


class Console:
    """Prints according to -q and -v."""

    def __init__(self, *, quiet: bool = False, verbosity: int = 0) -> None:
        """Choose what is printed: `quiet` nothing but errors, `verbosity` 1 each frame, 2 all."""
        self.quiet = quiet
        self.verbosity = verbosity
        self.results_on_stderr = False  # where stdout is kept for a report
        self._lost: OSError | None = None

    def result(self, text: str) -> None:
        """Print a result on stdout, or stderr where a report goes there, unless quiet."""
        if not self.quiet:
            self._lost = say(text, err=self.results_on_stderr) or self._lost

    def refuse_lost_results(self) -> None:
        """Raise OutputError if results could not be printed, for a command without other outputs.

        Whoever closed a pipe wants no more of them.
        """
        if self._lost is not None and not isinstance(self._lost, BrokenPipeError):
            raise OutputError(f"standard output: cannot be written: {self._lost.strerror}")

    def table(self, header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """Print aligned columns as results: the first to the left, the others to the right."""
        if self.quiet:
            return
        lines = [tuple(map(shown_line, row)) for row in (header, *rows)]
        widths = [max(len(line[k]) for line in lines) for k in range(len(header))]
        for line in lines:
            cells = [line[0].ljust(widths[0])]
            cells += [cell.rjust(width) for cell, width in zip(line[1:], widths[1:], strict=True)]
            self.result("  ".join(cells).rstrip())

    def remark(self, text: str) -> None:
        """Print a line on stderr with -v."""
        if self.verbosity and not self.quiet:
            say(text, err=True)

    def tell(self, text: str) -> None:
        """Print on stderr what every user should know, unless quiet."""
        if not self.quiet:
            say(f"dtrepair: {shown_line(text)}", err=True)

    def trace(self, error: BaseException | None) -> None:
        """Print on stderr where an error comes from, with -vv."""
        if error is not None and self.verbosity > 1:
            import traceback

            self.remark("".join(traceback.format_exception(error)).rstrip())

    def warn(self, texts: Iterable[str]) -> None:
        """Print warnings on stderr, unless quiet."""
        if not self.quiet:
            for text in texts:
                say(f"dtrepair: warning: {shown_line(text)}", err=True)
