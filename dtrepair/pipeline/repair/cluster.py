"""The connection to a Dask cluster, and what becomes of it."""

from __future__ import annotations

import logging
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dtrepair.pipeline.errors import UsageError, WorkersError

if TYPE_CHECKING:
    from distributed import Client, Future

# Seconds between two questions to the scheduler, and without any worker until a run is given up:
# a nanny starts a new one within a few.
BETWEEN = 2.0
PATIENCE = 30.0
LOST = "--distributed: the scheduler was lost; start it again, and the run"
_LOGGERS = ("distributed", "tornado", "asyncio")


@dataclass(frozen=True)
class Workers:
    """Where chunks are repaired: address of a scheduler, or "local" for `jobs` workers here.

    jobs: None for one for each processor. device: its name, as each worker is to understand it.
    """

    address: str
    jobs: int | None
    device: str


@contextmanager
def connected(workers: Workers) -> Iterator[Client]:
    """A client of the cluster at an address, or of one that lives as long as the block.

    What Dask would log is not seen: what was lost is told once, by an error.
    """
    address = workers.address
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        install = "pip install 'dtrepair[distributed]'"
        raise UsageError(f"--distributed: needs the package distributed; {install}") from None
    if address == "local":
        from dtrepair.repair.parallel.worker_pool import available_processors

        count = workers.jobs or available_processors()
        # Even without a dashboard there is a server, which warns of a port that is taken.
        options = {"dashboard_address": ":0", "scheduler_kwargs": {"dashboard": False}}
        with (
            LocalCluster(n_workers=count, threads_per_worker=1, **options) as cluster,
            Client(cluster) as client,
            _quiet(),
        ):
            yield client
        return
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise UsageError(f"--distributed {address}: no scheduler answers: {error}") from None
    with _quiet(), client:
        yield client


def workers_of(client: Client, address: str) -> dict[str, Any]:
    """What the scheduler tells of its workers. Raises UsageError where there are none."""
    workers: dict[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
    if not workers:
        raise UsageError(f"--distributed {address}: the scheduler has no workers; start some")
    return workers


class Watch:
    """Called now and then, it looks whether the workers are still there."""

    def __init__(self, client: Client, address: str) -> None:
        """All is well now."""
        self._client, self._address = client, address
        self._asked = self._seen = clock.monotonic()

    def __call__(self) -> None:
        """Raise WorkersError if the scheduler is gone, or there was no worker for a while."""
        if self._client.status != "running":  # what was submitted is lost with the connection
            raise WorkersError(LOST)
        now = clock.monotonic()
        if now - self._asked < BETWEEN:
            return
        self._asked = now
        if self._client.scheduler_info(n_workers=-1)["workers"]:
            self._seen = now
        elif now - self._seen > PATIENCE:
            raise WorkersError(
                f"--distributed {self._address}: all workers were lost; start some, and the run"
            )

    def cancel(self, futures: Sequence[Future[Any]]) -> None:
        """Cancel what is still to be done, if anybody is there to hear it."""
        if self._client.status == "running":
            with suppress(OSError):
                self._client.cancel(futures)


@contextmanager
def _quiet() -> Iterator[None]:
    """Log nothing of Dask."""
    known = [logging.getLogger(name) for name in [*logging.root.manager.loggerDict, *_LOGGERS]]
    heard = [
        logger
        for logger in known
        if logger.name.partition(".")[0] in _LOGGERS and not logger.disabled
    ]
    for logger in heard:
        logger.disabled = True
    try:
        yield
    finally:
        for logger in heard:
            logger.disabled = False
