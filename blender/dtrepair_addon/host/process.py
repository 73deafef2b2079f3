"""The worker process, seen from Blender: started, listened to without waiting, ended."""

from __future__ import annotations

import json
import os
import queue
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .exchange import Request, write_request
from .interpreter import passed_on

# The folder of the add-on, which the worker runs as a package whatever Blender calls it.
PACKAGE = Path(__file__).parents[1]
# The add-on's folder comes last, so that nothing beside it hides what the worker's Python has.
_START = "import runpy, sys; sys.path.append(sys.argv.pop(1)); runpy.run_module(sys.argv.pop(1), "
_START += "run_name='__main__', alter_sys=True)"


class WorkerError(Exception):
    """The worker ended without a result; the message says why."""


@dataclass
class Progress:
    """What the worker told last: the phase, its frames, those done, and all warnings."""

    phase: str = "starting"
    total: int = 0
    done: float = 0.0
    warnings: list[str] = field(default_factory=list)


class Worker:
    """A request in work, in a folder of its own, which `close` removes.

    Args:
        python: the interpreter that has dtrepair.
        request: what is asked.
    """

    def __init__(self, python: Path, request: Request) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="dtrepair_"))
        self.progress = Progress()
        try:
            write_request(self.folder, request)
            self._errors = (self.folder / "stderr.txt").open("w+", encoding="utf-8")
            self._process = self._started(python)
        except BaseException:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def running(self) -> bool:
        """Whether the process is alive."""
        return self._process.poll() is None

    def poll(self) -> dict[str, Any] | None:
        """Return the result where there is one, None while the worker is at work; never waits.

        Raises:
            WorkerError: it ended without.
        """
        while not self._lines.empty():
            if (found := self._heard(self._lines.get())) is not None:
                return found
        return None

    def wait(self) -> dict[str, Any]:
        """Return the result; waits for it. Raises WorkerError where there is none."""
        while (found := self._heard(self._lines.get())) is None:
            pass
        return found

    def close(self) -> None:
        """End the process, with all that it started, and remove its folder."""
        if self.running:
            self._end()
        self._process.wait()
        self._errors.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _started(self, python: Path) -> subprocess.Popen[str]:
        module = f"{PACKAGE.name}.worker.main"
        return subprocess.Popen(
            [python, "-P", "-c", _START, str(PACKAGE.parent), module, str(self.folder)],
            stdout=subprocess.PIPE,
            stderr=self._errors,
            stdin=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
            cwd=self.folder,
            env={**passed_on(os.environ), "PYTHONIOENCODING": "utf-8"},
            start_new_session=sys.platform != "win32",
        )

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put(None)

    def _heard(self, line: str | None) -> dict[str, Any] | None:
        if line is None:
            code = self._process.wait()
            raise WorkerError(f"the worker ended with exit code {code}: {self._last_words()}")
        if not line.startswith("{"):  # something that a library printed
            return None
        told: dict[str, Any] = json.loads(line)
        event = told.pop("event")
        progress = self.progress
        if event == "error":
            raise WorkerError(str(told["message"]))
        if event == "start":
            progress.phase, progress.total, progress.done = told["phase"], told["total"], 0.0
        elif event == "advance":
            progress.done = told["done"]
        elif event == "warning":
            progress.warnings.append(told["text"])
        return told if event == "done" else None

    def _last_words(self) -> str:
        self._errors.seek(0)
        lines = self._errors.read().strip().splitlines()
        return lines[-1] if lines else "it said nothing"

    def _end(self) -> None:
        if sys.platform == "win32":
            tree = ["taskkill", "/F", "/T", "/PID", str(self._process.pid)]
            subprocess.run(tree, capture_output=True)
        else:
            os.killpg(self._process.pid, signal.SIGKILL)
