"""Chunks of a clip on the workers of a Dask cluster, joined at the end."""

from __future__ import annotations

import os
import shutil
import time as clock
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from dtrepair.pipeline.errors import INTERNAL, InputError, PipelineError, WorkersError, plain_error
from dtrepair.pipeline.observer import Observer, Progress
from dtrepair.pipeline.repair.chunks import worthwhile_chunks
from dtrepair.pipeline.repair.cluster import LOST, Watch, Workers, connected, workers_of
from dtrepair.pipeline.repair.motion import Motion
from dtrepair.pipeline.repair.settings import RepairSettings
from dtrepair.pipeline.stages.frames import read_frame
from dtrepair.pipeline.stages.outputs import writing
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.joining import join_reports
from dtrepair.report.record import Report

if TYPE_CHECKING:
    from distributed import Future

Repair = Callable[..., Report]  # as `dtrepair.pipeline.repair_stage`

# Seconds between two looks at the workers.
PAUSE = 0.1


def repair_distributed(
    repair: Repair,
    source: Source,
    output: str,
    settings: RepairSettings,
    workers: Workers,
    observer: Observer,
) -> Report:
    """Repair one chunk on each worker, join the layers into `output`, and the reports.

    repair: repairs a chunk; the workers see the same files at the same paths.
    """
    from usd_io import join_layers
    from usd_io.write.temporary import make_temporary_folder

    target = os.path.abspath(output)
    with ExitStack() as stack:
        client = stack.enter_context(connected(workers))
        with writing(output):
            folder = make_temporary_folder(target)
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        threads = [worker["nthreads"] for worker in workers_of(client, workers.address).values()]
        count = worthwhile_chunks(source, len(threads), alone=settings.single)
        parts = [os.path.join(folder, f"part{number}.usdc") for number in range(1, count + 1)]
        each = {"jobs": max(threads), "device": workers.device}
        futures = [
            client.submit(
                repair_chunk,
                repair,
                os.getcwd(),
                source.name,
                part,
                replace(settings, chunk=f"{number}/{count}"),
                **each,
                pure=False,
            )
            for number, part in enumerate(parts, 1)
        ]
        watch = Watch(client, workers.address)
        stack.callback(watch.cancel, futures)
        with Progress(observer, "chunks repaired", count) as progress:

            def meanwhile() -> None:
                progress.ahead(0.0)
                watch()

            ended = _ended(futures, meanwhile)
            reports = {future.key: _result(future) for future in progress.over(ended)}
        join_layers(parts, target)
        return join_reports([reports[future.key] for future in futures])


def measured_jitter(source: Source, result: Source) -> float | None:
    """The largest jitter of any mesh, from the input and the output that was joined of chunks."""
    if len(source.times) < 3:
        return None
    motion = Motion(source)
    for time in map(float, source.times):
        motion.add(time, read_frame(source, time).spaces, read_frame(result, time).spaces)
    return motion.jitter


def repair_chunk(
    repair: Repair,
    directory: str,
    stage: str,
    output: str,
    settings: RepairSettings,
    *,
    jobs: int,
    device: str,
) -> dict[str, Any]:
    """Repair a chunk on a worker, in a directory; return the document of its report."""
    try:
        os.chdir(directory)
    except OSError as error:
        raise InputError(
            f"{directory}: {error.strerror}; workers need the same files, same paths"
        ) from None
    try:
        return repair(stage, output, settings, jobs=jobs, device=device).document()
    except Exception as error:  # only plain errors are sure to travel
        raise plain_error(error) from None


def _ended(futures: Sequence[Future[Any]], meanwhile: Callable[[], None]) -> Iterator[Future[Any]]:
    """The futures as they end; `meanwhile` is called again and again while none does."""
    waiting = list(futures)
    while waiting:
        for future in [future for future in waiting if future.done()]:
            waiting.remove(future)
            yield future
        meanwhile()
        clock.sleep(PAUSE)


def _result(future: Future[Any]) -> dict[str, Any]:
    """The report of a chunk; one that made no layer ends the run."""
    from distributed import KilledWorker

    if future.status not in ("finished", "error"):  # what was lost has neither
        raise WorkersError(LOST)
    error = future.exception() if future.status == "error" else None
    if isinstance(error, PipelineError):
        raise PipelineError(f"a worker failed: {error}", error.exit_code)
    if isinstance(error, KilledWorker):
        raise WorkersError(
            "workers were lost with the same chunk, again and again; if memory ran out, start "
            "workers with more of it"
        )
    if error is not None:
        raise PipelineError(f"a worker failed: {type(error).__name__}: {error}", INTERNAL)
    document: dict[str, Any] = future.result()
    return document
