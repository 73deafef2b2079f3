"""Calls side by side in processes that inherit everything that was built before."""

from __future__ import annotations

import ctypes
import gc
import io
import os
import pickle
import signal
import sys
import threading
import traceback
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from typing import Any, NoReturn, TypeVar

from dtrepair.device import cuda_in_use
from dtrepair.numerics.threads import one_thread

Item = TypeVar("Item")
Answer = TypeVar("Answer")

# prctl: the signal that a process gets when its parent ends, however that ends.
_DEATH_SIGNAL = 1

# So often is tried what a process that ended without an answer was at.
ATTEMPTS = 3


def can_fork() -> bool:
    """Return whether processes can be forked: on Linux, and not where a GPU is at work."""
    return sys.platform == "linux" and not cuda_in_use()


def fork(work: Callable[[], None]) -> int:
    """Return the number of a new process that does some work and ends; it never outlives this one.

    It leaves signals to its parent, which should end it with `end`.
    """
    parent, prctl = os.getpid(), ctypes.CDLL(None).prctl
    number = 0
    try:
        with _signals_held(), warnings.catch_warnings():
            # Python warns of locks that other threads hold; the child touches nothing of theirs.
            warnings.simplefilter("ignore", DeprecationWarning)
            number = os.fork()
            if not number:  # signals that were held are the parent's
                _work_and_exit(work, parent, prctl)
    except BaseException:
        if number:
            end(number)
        raise
    return number


def _work_and_exit(work: Callable[[], None], parent: int, prctl: Any) -> NoReturn:
    try:
        prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() == parent:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            gc.freeze()  # a collection would write to, and so copy, all that is shared
            with one_thread():  # processes with threads of linear algebra starve each other
                work()
            os._exit(0)
    finally:
        os._exit(1)


@contextmanager
def _signals_held() -> Iterator[None]:
    """Handle signals after the block: what a handler raises inside of os.fork is lost.

    Python runs the handlers in the main thread only, so that elsewhere there is nothing to do.
    """
    held: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        for caught in (signal.SIGINT, signal.SIGTERM):
            if callable(signal.getsignal(caught)):
                handlers[caught] = signal.signal(caught, lambda number, _: held.append(number))
    try:
        yield
    finally:
        for caught, handler in handlers.items():
            signal.signal(caught, handler)
        for number in held:
            signal.raise_signal(number)


def end(number: int) -> None:
    """End a forked process at once."""
    with suppress(ProcessLookupError, ChildProcessError):
        os.kill(number, signal.SIGKILL)
        os.waitpid(number, 0)


class _Pickler(pickle.Pickler):
    """Gives exceptions a note of where they were raised, which pickles leave out."""

    def reducer_override(self, value: object) -> Any:
        if isinstance(value, Exception) and value.__traceback__ is not None:
            trace = "".join(traceback.format_tb(value.__traceback__))
            value.add_note(f"Raised in a worker process:\n{trace}".rstrip())
            value.__traceback__ = None
        return NotImplemented


def packed(call: Callable[[], Any]) -> bytes:
    """Return the answer of a call, or its exception, for `unpacked` in another process."""
    try:
        return _pickled((None, call()))
    except Exception as error:
        return _pickled((error, None))


def _pickled(value: object) -> bytes:
    stream = io.BytesIO()
    _Pickler(stream, protocol=5).dump(value)
    return stream.getvalue()


class WorkerLost(RuntimeError):
    """A process ended without an answer, as the system ends them where memory runs out.

    Attributes:
        exit_code: what a command should end with.
    """

    exit_code = 7

    def __init__(self) -> None:
        """Say what a user can do; what was lost has been tried again before."""
        super().__init__(
            f"worker processes ended without an answer, {ATTEMPTS} times; if memory ran out, use "
            "fewer jobs"
        )


def unpacked(content: bytes) -> Any:
    """Return the answer in what `packed` made, or raise its exception.

    WorkerLost if there is nothing: the process has ended without an answer.
    """
    if not content:
        raise WorkerLost
    error, answer = pickle.loads(content)
    if error is not None:
        raise error
    return answer


def in_batches(items: Iterable[Item], size: int) -> Iterator[list[Item]]:
    """Yield items in lists of `size`; the last may be shorter."""
    iterator = iter(items)
    while batch := list(islice(iterator, size)):
        yield batch


def map_in_processes(
    function: Callable[[Item], Answer], items: Iterable[Item], *, jobs: int, ahead: int = 3
) -> Iterator[Answer]:
    """Yield the answers of function(item) in the order of the items, found by `jobs` processes.

    A process is forked when there is an item for it, and sees the state of that moment; from then
    on only items and answers go to and fro. Items are taken when a process is free. With one job,
    or where processes cannot be forked, the calls are made here. Exceptions of a call are raised
    here. An item whose process ended without an answer goes to a new one; WorkerLost where that
    happens again and again. Processes never outlive the iterator. `ahead` items for each process
    are on their way at most: answers wait here for an earlier one.
    """
    if jobs == 1 or not can_fork():
        yield from map(function, items)
        return
    pool = _ProcessPool(function, jobs)
    waiting: deque[int] = deque()
    try:
        for number, item in enumerate(items):
            while pool.full or len(waiting) >= ahead * jobs:
                if waiting[0] in pool.answers:
                    yield pool.take(waiting.popleft())
                else:
                    pool.receive()
            pool.start(number, item)
            waiting.append(number)
        while waiting:
            if waiting[0] in pool.answers:
                yield pool.take(waiting.popleft())
            else:
                pool.receive()
    finally:
        pool.close()


class _ProcessPool:
    """Processes that call one function; `answers`, packed, by the number of the item."""

    def __init__(self, function: Callable[[Any], Any], jobs: int) -> None:
        self._function, self._jobs = function, jobs
        self._processes: list[int] = []
        self._idle: list[Connection] = []
        self._busy: dict[Connection, tuple[int, Any]] = {}
        self._lost: Counter[int] = Counter()  # processes, by the number of the item
        self.answers: dict[int, bytes] = {}

    @property
    def full(self) -> bool:
        return not self._idle and len(self._busy) == self._jobs

    def start(self, number: int, item: Any) -> None:
        connection = self._idle.pop() if self._idle else self._fork()
        self._busy[connection] = number, item
        with suppress(ConnectionError):  # it has ended: nothing will be received
            connection.send(item)

    def receive(self) -> None:
        """Wait for answers."""
        for connection in wait(list(self._busy)):
            assert isinstance(connection, Connection)
            number, item = self._busy.pop(connection)
            try:
                self.answers[number] = connection.recv_bytes()
                self._idle.append(connection)
            except (EOFError, ConnectionError):
                connection.close()
                self._lost[number] += 1
                if self._lost[number] < ATTEMPTS:
                    self.start(number, item)
                else:
                    self.answers[number] = b""

    def take(self, number: int) -> Any:
        return unpacked(self.answers.pop(number))

    def close(self) -> None:
        for process in self._processes:
            end(process)

    def _fork(self) -> Connection:
        here, there = Pipe()

        def work() -> None:
            while True:
                item = there.recv()
                there.send_bytes(packed(partial(self._function, item)))

        self._processes.append(fork(work))
        there.close()
        return here
