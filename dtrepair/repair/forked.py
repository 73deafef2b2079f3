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
from contextlib import suppress
from typing import Any, NamedTuple, TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")

# prctl: the signal that a process gets when its parent ends, however that ends.
_DEATH_SIGNAL = 1


def can_fork() -> bool:
    """Whether processes can be forked: elsewhere than on Linux, libraries do not survive it."""
    return sys.platform == "linux"


def fork(work: Callable[[], None]) -> int:
    """The number of a new process that does some work and ends; it never outlives this one.

    It leaves signals to its parent, which should end it with `end`.
    """
    parent, prctl = os.getpid(), ctypes.CDLL(None).prctl
    with warnings.catch_warnings():
        # Python warns of locks that other threads hold; the child touches nothing of theirs.
        warnings.simplefilter("ignore", DeprecationWarning)
        number = os.fork()
    if number:
        return number
    try:
        prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() == parent:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            work()
            os._exit(0)
    finally:
        os._exit(1)


def end(number: int) -> None:
    """End a forked process at once."""
    with suppress(ProcessLookupError, ChildProcessError):
        os.kill(number, signal.SIGKILL)
        os.waitpid(number, 0)


def packed(call: Callable[[], Any]) -> bytes:
    """The answer of a call, or its exception, for `unpacked` in another process."""
    try:
        return pickle.dumps((None, call()), protocol=5)
    except Exception as error:
        return pickle.dumps((error, None))


def unpacked(content: bytes) -> Any:
    """The answer in what `packed` made; its exception is raised.

    RuntimeError if there is nothing: the process has ended without an answer.
    """
    if not content:
        raise RuntimeError(
            "a worker process ended without an answer; if memory ran out, use fewer jobs"
        )
    error, answer = pickle.loads(content)
    if error is not None:
        raise error
    return answer


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
    running: deque[_Call] = deque()
    try:
        for item in items:
            if len(running) == jobs:
                yield running.popleft().answer()
            running.append(_start(function, item))
        while running:
            yield running.popleft().answer()
    finally:
        for call in running:
            end(call.process)
            os.close(call.file)


class _Call(NamedTuple):
    """A forked process, and the file in memory that it writes its answer to."""

    process: int
    file: int

    def answer(self) -> Any:
        """Wait for the answer; the exception of the call is raised."""
        try:
            os.waitpid(self.process, 0)
        except BaseException:
            end(self.process)
            raise
        with os.fdopen(self.file, "rb") as file:
            file.seek(0)  # both processes share one position
            return unpacked(file.read())


def _start(function: Callable[[Item], Answer], item: Item) -> _Call:
    file = os.memfd_create("answer")

    def work() -> None:
        with os.fdopen(file, "wb") as stream:
            stream.write(packed(lambda: function(item)))

    return _Call(fork(work), file)
