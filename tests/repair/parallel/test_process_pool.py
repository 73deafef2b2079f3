"""Calls in forked processes."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import numpy as np
import pytest
from numpy.typing import NDArray
from threadpoolctl import threadpool_info, threadpool_limits

from dtrepair.repair.parallel.process_pool import (
    ATTEMPTS,
    WorkerLost,
    can_fork,
    map_in_processes,
)
from tests.present import present

pytestmark = pytest.mark.skipif(not can_fork(), reason="needs processes that can be forked")


def appears(path: Path) -> bool:
    """Wait for a file of another process; a minute means that it never comes."""
    for _ in range(6000):
        if path.exists():
            return True
        time.sleep(0.01)
    return False


def test_answers_come_in_order_from_other_processes(tmp_path: Path) -> None:
    def square(number: int) -> tuple[int, NDArray[Any]]:
        if number % 2 == 0:
            assert appears(tmp_path / str(number + 1))
        else:
            (tmp_path / str(number)).touch()
        return os.getpid(), np.full(100_000, number**2)

    found = list(map_in_processes(square, range(6), jobs=3))
    assert [int(values[0]) for _, values in found] == [0, 1, 4, 9, 16, 25]
    processes = {process for process, _ in found}
    assert 2 <= len(processes) <= 3 and os.getpid() not in processes


def test_one_job_stays_in_this_process() -> None:
    assert set(map_in_processes(lambda _: os.getpid(), range(3), jobs=1)) == {os.getpid()}


def test_items_are_taken_when_a_process_is_free() -> None:
    taken = []

    def items() -> Iterator[int]:
        for number in range(20):
            taken.append(number)
            yield number

    answers = map_in_processes(lambda number: number, items(), jobs=2, ahead=2)
    assert next(answers) == 0
    assert len(taken) <= 2 * 2 + 1
    assert list(answers) == list(range(1, 20))


def test_a_slow_item_keeps_only_one_process(tmp_path: Path) -> None:
    def last_of_all(number: int) -> bool:
        if number == 0:
            return all(appears(tmp_path / str(other)) for other in range(1, 5))
        (tmp_path / str(number)).touch()
        return True

    assert list(map_in_processes(last_of_all, range(5), jobs=2)) == [True] * 5


def test_an_exception_is_raised_here() -> None:
    def fail(number: int) -> int:
        if number == 1:
            raise ValueError(f"no {number}")
        return number

    answers = map_in_processes(fail, range(3), jobs=2)
    assert next(answers) == 0
    with pytest.raises(ValueError, match="no 1"):
        next(answers)


def test_an_exception_tells_where_it_was_raised() -> None:
    def deep_inside(number: int) -> NoReturn:
        raise ValueError(f"no {number}")

    def answered(number: int) -> ValueError | None:
        try:
            deep_inside(number)
        except ValueError as error:
            return error

    with pytest.raises(ValueError, match="no 0") as raised:
        list(map_in_processes(deep_inside, range(2), jobs=2))
    for error in (raised.value, *map_in_processes(answered, range(2), jobs=2)):
        (note,) = present(error).__notes__
        assert "in deep_inside" in note


def test_a_process_that_is_killed_each_time_is_told(tmp_path: Path) -> None:
    def killed(_: object) -> None:
        (tmp_path / str(os.getpid())).touch()
        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(WorkerLost, match="fewer jobs"):
        list(map_in_processes(killed, [0], jobs=2))
    assert len(list(tmp_path.iterdir())) == ATTEMPTS


def test_what_a_killed_process_was_at_is_done_by_another(tmp_path: Path) -> None:
    def fragile(number: int) -> int:
        if number in (1, 4) and not (tmp_path / str(number)).exists():
            (tmp_path / str(number)).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return number**2

    assert list(map_in_processes(fragile, range(6), jobs=2)) == [0, 1, 4, 9, 16, 25]


def test_what_a_process_that_is_killed_while_it_waits_would_do_is_done_by_others() -> None:
    answers = map_in_processes(lambda _: os.getpid(), iter(range(8)), jobs=2, ahead=1)
    # There may be a second one; two items at most are on their way.
    killed = {next(answers), next(answers)}
    for process in killed:
        os.kill(process, signal.SIGKILL)
    others = list(answers)
    assert len(others) == 6 and os.getpid() not in others and not killed & set(others[2:])


def test_a_signal_during_the_fork_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    forked, fork = [], os.fork

    def interrupted_fork() -> int:
        number = fork()
        if number:
            forked.append(number)
            with suppress(KeyboardInterrupt):  # as Python does with what its hooks raise
                signal.raise_signal(signal.SIGINT)
        return number

    monkeypatch.setattr(os, "fork", interrupted_fork)
    with pytest.raises(KeyboardInterrupt):
        list(map_in_processes(lambda number: number, range(3), jobs=2))
    assert len(forked) == 1
    with pytest.raises(ProcessLookupError):
        os.kill(forked[0], 0)


def test_a_signal_before_the_fork_stays_out_of_the_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fork = os.fork

    def interrupted_fork() -> int:
        signal.raise_signal(signal.SIGINT)
        return fork()

    monkeypatch.setattr(os, "fork", interrupted_fork)
    here, escaped = os.getpid(), tmp_path / "escaped"
    with pytest.raises(KeyboardInterrupt):
        try:
            list(map_in_processes(lambda number: number, range(3), jobs=2))
        finally:
            if os.getpid() != here:
                escaped.touch()
                os._exit(1)
    assert not escaped.exists()


def test_no_process_outlives_the_iterator(tmp_path: Path) -> None:
    def wait(number: int) -> None:
        (tmp_path / str(number)).write_text(str(os.getpid()))
        time.sleep(0 if number == 0 else 60)

    answers = map_in_processes(wait, range(3), jobs=2)
    next(answers)
    while not (tmp_path / "1").exists() or not (tmp_path / "1").read_text():
        time.sleep(0.01)
    assert isinstance(answers, Generator)
    answers.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "1").read_text()), 0)


@pytest.mark.parametrize("who", ["torch", "warp"])
def test_a_process_that_works_on_a_gpu_is_not_forked(
    monkeypatch: pytest.MonkeyPatch, who: str
) -> None:
    devices = [SimpleNamespace(has_context=who == "warp")]
    cuda = SimpleNamespace(is_initialized=lambda: who == "torch")
    monkeypatch.setitem(sys.modules, "torch", SimpleNamespace(cuda=cuda))
    monkeypatch.setitem(sys.modules, "warp", SimpleNamespace(get_cuda_devices=lambda: devices))
    assert not can_fork()
    assert set(map_in_processes(lambda _: os.getpid(), range(3), jobs=2)) == {os.getpid()}
    devices[0].has_context = False
    cuda.is_initialized = lambda: False
    assert can_fork()


def test_processes_do_not_share_the_cores_with_threads_of_linear_algebra() -> None:
    def threads(_: object) -> int:
        result: int = max(library["num_threads"] for library in threadpool_info())
        return result

    with threadpool_limits(2):
        if threads(None) < 2:
            pytest.skip("linear algebra has a single thread here")
        assert list(map_in_processes(threads, range(2), jobs=2)) == [1, 1]
        assert threads(None) == 2
