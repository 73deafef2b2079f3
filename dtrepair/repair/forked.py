"""Calls side by side in forked processes, which inherit everything that was built before."""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")

# prctl: the signal that a process gets when its parent ends, however that ends.
_DEATH_SIGNAL = 1


def can_fork() -> bool:
    """Whether processes can be forked: elsewhere than on Linux, libraries do not survive it."""
    return sys.platform == "linux"


def forked_map(
    function: Callable[[Item], Answer], items: Iterable[Item], *, jobs: int
) -> Iterator[Answer]:
    """Answers of function(item) in the order of the items, at most `jobs` processes at a time.

    Each call has a process of its own: it sees the state of this one at the time of the fork, and
    only its answer comes back. Items are taken when a process is free. With one job, or where
    processes cannot be forked, the calls are made here. Exceptions of a call are raised here;
    RuntimeError where a process ended without an answer. Processes never outlive the iterator.
    """
    if jobs == 1 or not can_fork():
        yield from map(function, items)
        return
    running: deque[_Process] = deque()
    try:
        for item in items:
            if len(running) == jobs:
                yield running[0].answer()
                running.popleft()
            running.append(_fork(function, item))
        while running:
            yield running[0].answer()
            running.popleft()
    finally:
        for process in running:
            process.end()


class _Process(NamedTuple):
    """A forked process, and the file in memory that it writes its answer to."""

    number: int
    file: int

    def answer(self) -> Any:
        """Wait for the answer; the exception of the call is raised."""
        _, status = os.waitpid(self.number, 0)
        with os.fdopen(self.file, "rb") as file:
            file.seek(0)  # both processes share one position
            content = file.read()
        if status or not content:
            raise RuntimeError(
                f"a worker process ended without an answer (status {status}); "
                "if memory ran out, use fewer jobs"
            )
        failed, answer = pickle.loads(content)
        if failed:
            raise answer
        return answer

    def end(self) -> None:
        """End the process at once, unless it was waited for."""
        try:
            os.kill(self.number, signal.SIGKILL)
            os.waitpid(self.number, 0)
            os.close(self.file)
        except (ProcessLookupError, ChildProcessError, OSError):
            pass


def _fork(function: Callable[[Item], Answer], item: Item) -> _Process:
    file = os.memfd_create("answer")
    parent, prctl = os.getpid(), ctypes.CDLL(None).prctl
    with warnings.catch_warnings():
        # Python warns of locks that other threads hold; the child touches nothing of theirs.
        warnings.simplefilter("ignore", DeprecationWarning)
        number = os.fork()
    if number:
        return _Process(number, file)
    try:
        prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() == parent:
            _run(function, item, file)
            os._exit(0)
    finally:
        os._exit(1)


def _run(function: Callable[[Item], Answer], item: Item, file: int) -> None:
    """In the child: write the answer, or the exception. Signals are the parent's business."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        content = pickle.dumps((False, function(item)), protocol=5)
    except Exception as error:
        content = pickle.dumps((True, error))
    with os.fdopen(file, "wb") as stream:
        stream.write(content)
