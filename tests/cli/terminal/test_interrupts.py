"""Signals: an orderly end, a forced one where threads are busy, handlers put back."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading

import pytest

from dtrepair.cli.terminal.interrupts import Interrupts, Terminated, exit_code, watched

BUSY = """
import threading
from dtrepair.cli.terminal.interrupts import watched
with watched() as interrupts:
    interrupts.cleanups.append(lambda: print("cleaned", flush=True))
    interrupts.advice = "; advice"
    try:
        print("busy", flush=True)
        threading.Event().wait()
    finally:
        threading.Event().wait()  # as for threads that never end
"""


def test_busy_threads_do_not_hold_up_the_end() -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", BUSY], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "busy\n"
    process.send_signal(signal.SIGTERM)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM
    assert out == "cleaned\n"
    assert "dtrepair: error: interrupted; no output was written; advice\n" in err


def test_handlers_are_put_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with watched():
        assert signal.getsignal(signal.SIGTERM) != before
    assert signal.getsignal(signal.SIGTERM) == before
    assert signal.set_wakeup_fd(-1) == -1


def test_other_threads_do_without() -> None:
    found = []

    def enter() -> None:
        with watched() as interrupts:
            found.append(interrupts)

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert isinstance(found[0], Interrupts)


def test_exit_codes_and_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code(KeyboardInterrupt()) == 130 and exit_code(Terminated()) == 143
    interrupts = Interrupts()
    interrupts.say()
    interrupts.say()
    assert capsys.readouterr().err.count("\n") == 1
