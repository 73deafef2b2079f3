"""What a console shows of a run while it goes on."""

from __future__ import annotations

import os
from collections.abc import Callable

from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.interrupts import current_interrupts
from dtrepair.cli.terminal.modelled_text import (
    modelled_line,
    passing_line,
    props_line,
    sets_line,
    worn_line,
)
from dtrepair.cli.terminal.progress import ProgressBar, heartbeat, wanted
from dtrepair.cli.terminal.repair_text import correction_line
from dtrepair.pipeline.observer import (
    CorrectionWritten,
    FrameDone,
    ModelledFound,
    Observer,
    PassingFound,
    ProgressKept,
    PropsFound,
    Remark,
    SetsFound,
    SpansDone,
    Trouble,
    WornFound,
)

SayFrame = Callable[[Console, FrameDone], None]


class ConsoleObserver(Observer):
    """Prints warnings, frames with -v and where errors come from with -vv; tells progress.

    Ctrl-C ends a run by a KeyboardInterrupt of its own, so that `cancelled` never does.
    """

    def __init__(
        self, console: Console, say_frame: SayFrame | None = None, *, output: str | None = None
    ) -> None:
        """Print on a console; `say_frame` prints what became of a frame; None: nothing does.

        output: what a run writes; that an older one is replaced is told when its work begins.
        """
        self.console, self._say_frame = console, say_frame
        self._bar: ProgressBar | None = None
        self._older = output if output and os.path.isfile(output) else None
        self._heartbeat = None if console.quiet else heartbeat(console.tell)

    def start(self, phase: str, total: int) -> None:
        """Show a progress bar where one is wanted, else a line now and then."""
        if self._older is not None:
            self.console.tell(f"{self._older}: exists, and is replaced when this run is done")
            self._older = None
        if not self.console.quiet and wanted(total):
            self._bar = ProgressBar(phase, total)
        if self._heartbeat is not None:
            self._heartbeat.start(phase, total)

    def advance(self, done: float) -> None:
        """Move the bar."""
        if self._bar is not None:
            self._bar.show(done)
        if self._heartbeat is not None:
            self._heartbeat.advance(done)

    def end(self) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None
        if self._heartbeat is not None:
            self._heartbeat.end()

    def warning(self, text: str) -> None:
        """Print a warning."""
        self.console.warn([text])

    def remark(self, remark: Remark) -> None:
        """Print what a remark says, as far as -v and -vv ask for it."""
        if isinstance(remark, FrameDone):
            self.console.trace(remark.error)
            if self._say_frame is not None:
                self._say_frame(self.console, remark)
        elif isinstance(remark, ModelledFound):
            self.console.tell(modelled_line(remark.attached))
        elif isinstance(remark, PassingFound):
            self.console.tell(passing_line(remark.parts))
        elif isinstance(remark, WornFound):
            self.console.tell(worn_line(remark.worn))
        elif isinstance(remark, SetsFound):
            self.console.tell(sets_line(remark.paths))
        elif isinstance(remark, PropsFound):
            self.console.tell(props_line(remark.paths))
        elif isinstance(remark, SpansDone):
            self.console.remark(f"{remark.done} of {remark.total} spans done")
        elif isinstance(remark, CorrectionWritten):
            self.console.tell(correction_line(remark))
        elif isinstance(remark, Trouble):
            self.console.trace(remark.error)
        elif isinstance(remark, ProgressKept):
            interrupts = current_interrupts()
            if interrupts is not None:
                interrupts.advice = "; --resume goes on from here" if remark.entries else ""
