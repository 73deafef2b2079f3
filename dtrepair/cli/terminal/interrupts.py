"""Ctrl-C and SIGTERM: an orderly end at once, a forced one where the program is deep in work."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType

import click

from dtrepair.cli.terminal.streams import say
from dtrepair.pipeline.stages.outputs import remove_unfinished

# Seconds for an orderly end.
GRACE = 1.0
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Terminated(KeyboardInterrupt):
    """SIGTERM; the same as Ctrl-C but for the exit code."""


class Interrupts:
    """What happens on a signal.

    The main thread gets a KeyboardInterrupt. If it, or threads it waits for, have not ended after
    `GRACE` seconds, a watcher calls the functions of `cleanups`, prints one line and exits.
    advice: what to add to that line.
    """

    def __init__(self) -> None:
        """Nothing to clean up yet."""
        self.cleanups: list[Callable[[], None]] = []
        self.advice = ""
        self._said = False

    def say(self) -> None:
        """Print one error line, the first time only."""
        if not self._said:
            self._said = True
            line = f"interrupted; no output was written{self.advice}"
            say(f"dtrepair: error: {line}", err=True)

    def force(self, number: int) -> None:
        """Clean up and exit without waiting for anything."""
        for cleanup in self.cleanups:
            cleanup()
        self.say()
        os._exit(128 + number)


def current_interrupts() -> Interrupts | None:
    """The interrupts of the command that is running."""
    context = click.get_current_context(silent=True)
    return context.find_object(Interrupts) if context is not None else None


def clean_up_if_forced(output: str) -> None:
    """Have what was written of an output so far removed where the end must be forced."""
    interrupts = current_interrupts()
    if interrupts is not None:
        interrupts.cleanups.append(partial(remove_unfinished, output))


def exit_code(error: BaseException) -> int:
    """Exit code of an interrupted run: 130 for Ctrl-C, 143 for SIGTERM."""
    return 128 + (signal.SIGTERM if isinstance(error, Terminated) else signal.SIGINT)


@contextmanager
def watched() -> Iterator[Interrupts]:
    """Handle signals within the block; outside of the main thread Python allows none of it."""
    interrupts = Interrupts()
    if threading.current_thread() is not threading.main_thread():
        yield interrupts
        return
    bell, ear = socket.socketpair()
    bell.setblocking(False)
    old_handler = signal.signal(signal.SIGTERM, _terminate)
    old_bell = signal.set_wakeup_fd(bell.fileno(), warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(ear, interrupts), daemon=True).start()
    try:
        yield interrupts
    finally:
        signal.set_wakeup_fd(old_bell)
        signal.signal(signal.SIGTERM, old_handler)
        bell.close()


def _terminate(number: int, frame: FrameType | None) -> None:
    raise Terminated


def _watch(ear: socket.socket, interrupts: Interrupts) -> None:
    with ear:
        while heard := ear.recv(1):
            if heard[0] in _SIGNALS:
                time.sleep(GRACE)
                interrupts.force(heard[0])
