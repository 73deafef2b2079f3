"""A Dask cluster whose parts are lost: one line, a code, and nothing left over."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import dask
import pytest
from distributed import KilledWorker, LocalCluster

from dtrepair.pipeline import WorkersError
from dtrepair.pipeline.repair import cluster as cluster_module
from dtrepair.pipeline.repair import distributed
from dtrepair.pipeline.repair.cluster import Watch
from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_stage
from tests.present import present

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")

STARTED, ENDED = threading.Event(), threading.Event()


def chunk(*arguments: object, **options: object) -> dict[str, Any]:
    STARTED.set()
    ENDED.wait(60.0)
    return {}


@pytest.fixture
def cluster() -> Iterator[LocalCluster]:
    """A cluster in this process, of one worker."""
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "1s"}),  # to a scheduler that is lost
        LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            processes=False,
            protocol="tcp",
            dashboard_address=":0",
            scheduler_kwargs={"dashboard": False},
        ) as made,
    ):
        yield made
        ENDED.set()
        end_workers(made)


def end_workers(cluster: LocalCluster) -> None:
    """End the workers without waiting for what they do."""
    for worker in cluster.workers.values():
        cluster.sync(worker.close, executor_wait=False)


def while_it_runs(monkeypatch: pytest.MonkeyPatch, act: Callable[[], object]) -> None:
    """Act once the first chunk is at work, which has no end by itself."""
    STARTED.clear()
    ENDED.clear()
    ended = distributed._ended

    def after_the_start(*arguments: Any) -> Any:
        assert STARTED.wait(60.0)
        act()
        ENDED.set()
        return ended(*arguments)

    monkeypatch.setattr(distributed, "repair_chunk", chunk)
    monkeypatch.setattr(distributed, "_ended", after_the_start)


def test_a_lost_scheduler_is_one_line_and_a_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cluster: LocalCluster
) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "b.usdc"
    output.write_text("old")
    while_it_runs(monkeypatch, lambda: cluster.sync(present(cluster.scheduler).close))
    address = cluster.scheduler_address
    done = run("repair", path, "-o", output, "--alone", "--distributed", address)
    assert_fails(done, 7, "the scheduler was lost")
    assert output.read_text() == "old" and sorted(os.listdir(tmp_path)) == ["a.usdc", "b.usdc"]


def test_lost_workers_are_waited_for_no_longer_than_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cluster: LocalCluster
) -> None:
    path, output = tube_stage(tmp_path / "a.usdc", (CLOSED, OPEN)), tmp_path / "b.usdc"
    monkeypatch.setattr(cluster_module, "BETWEEN", 0.0)
    monkeypatch.setattr(cluster_module, "PATIENCE", 0.0)
    while_it_runs(monkeypatch, lambda: end_workers(cluster))
    address = cluster.scheduler_address
    done = run("repair", path, "-o", output, "--alone", "--distributed", address)
    assert_fails(done, 7, "all workers were lost")
    assert os.listdir(tmp_path) == ["a.usdc"]


def test_a_worker_that_comes_back_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    workers: list[dict[str, object]] = [{}, {"one": {}}, {}, {}]
    client: Any = SimpleNamespace(
        status="running", scheduler_info=lambda n_workers: {"workers": workers.pop(0)}
    )
    monkeypatch.setattr("dtrepair.pipeline.repair.cluster.clock.monotonic", lambda: now[0])
    watch = Watch(client, "tcp://host")
    for seconds in (1.0, 25.0, 40.0, 60.0):  # the first is too soon to ask
        now[0] = seconds
        watch()
    now[0] = 80.0
    with pytest.raises(WorkersError, match="tcp://host: all workers were lost"):
        watch()
    client.status = "connecting"
    with pytest.raises(WorkersError, match="the scheduler was lost"):
        watch()


def test_a_chunk_that_kills_each_worker_has_a_code() -> None:
    worker: Any = None
    error = KilledWorker("chunk", worker, 3)
    future: Any = SimpleNamespace(status="error", exception=lambda: error)
    with pytest.raises(WorkersError, match="again and again"):
        distributed._result(future)
