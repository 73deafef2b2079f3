"""`repair --distributed`: chunks of a clip on the workers of a Dask cluster, joined at the end."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

import click

from dtrepair.numerics.jitter_meter import JitterMeter
from dtrepair.pipeline.errors import INPUT, INTERNAL, PipelineError, UsageError
from dtrepair.pipeline.observer import Observer, Progress
from dtrepair.pipeline.stages.frames import read_frame
from dtrepair.pipeline.stages.outputs import writing
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.joining import join_reports
from dtrepair.report.record import Report, read_report

if TYPE_CHECKING:
    from distributed import Client

_ARGUMENTS = "dtrepair.arguments"


class ChunkedCommand(click.Command):
    """A command that keeps its arguments as they were given, for the workers."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Keep the arguments, then parse them."""
        context.meta[_ARGUMENTS] = list(args)
        return super().parse_args(context, args)


def distributed_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --distributed; None where it is not given, or empty."""
    return click.option(
        "--distributed",
        metavar="ADDRESS|local",
        callback=lambda context, parameter, value: value or None,
        help="Repair on the workers of a Dask scheduler, or of one started here.",
    )(function)


def repair_distributed(
    address: str, source: Source, output: str, *, jobs: int, observer: Observer
) -> Report:
    """Repair one chunk on each worker, join the layers into `output`, and the reports.

    The workers run this very command again, with `--chunk`; they see the same files at the same
    paths. `local` starts `jobs` workers here.
    """
    from usd_io import join_layers
    from usd_io.write.temporary import make_temporary_folder

    target = os.path.abspath(output)
    with ExitStack() as stack:
        client = stack.enter_context(_client(address, jobs))
        with writing(output):
            folder = make_temporary_folder(target)
        stack.callback(shutil.rmtree, folder, ignore_errors=True)
        threads = [worker["nthreads"] for worker in _workers(client, address).values()]
        count = min(len(threads), len(source.times))
        parts = [os.path.join(folder, f"part{number}.usdc") for number in range(1, count + 1)]
        done = _finished(client, parts, jobs=max(threads))
        for _ in Progress(observer, "chunks repaired", count).over(done):
            pass
        join_layers(parts, target)
        report = join_reports([read_report(_report_of(part)) for part in parts])
    return report


def measured_jitter(source: Source, result: Source) -> float | None:
    """The largest jitter of any mesh, from the input and the output that was joined of chunks."""
    if len(source.times) < 3:
        return None
    meters = [JitterMeter() for _ in source.meshes]
    for time in source.times:
        before, after = read_frame(source, float(time)), read_frame(result, float(time))
        for meter, *spaces in zip(meters, before.spaces, after.spaces, strict=False):
            meter.add(*spaces)
    return max(meter.value for meter in meters)


def repair_chunk(directory: str, arguments: Sequence[str]) -> tuple[int, str]:
    """Run `dtrepair repair` with arguments in a directory: exit code, and what was wrong."""
    from dtrepair.cli.app import group

    try:
        os.chdir(directory)
        code = group.main(["repair", *arguments], prog_name="dtrepair", standalone_mode=False)
    except PipelineError as error:
        return error.exit_code, str(error)
    except click.ClickException as error:
        return error.exit_code, error.format_message()
    except OSError as error:
        return INPUT, f"{directory}: {error.strerror}; workers need the same files, same paths"
    return int(code), ""


def _finished(client: Client, parts: Sequence[str], *, jobs: int) -> Iterator[int]:
    """Exit codes of the chunks as they end; the first that made no layer ends the run."""
    from distributed import as_completed

    given = click.get_current_context().meta[_ARGUMENTS]
    futures = []
    for number, part in enumerate(parts, 1):
        chunk = ["-o", part, "--chunk", f"{number}/{len(parts)}", "--report", _report_of(part)]
        # The last of several options of one name counts.
        arguments = [*given, *chunk, "--jobs", str(jobs), "--distributed", "", "-q"]
        futures.append(client.submit(repair_chunk, os.getcwd(), arguments, pure=False))
    for future in as_completed(futures):
        error = future.exception()
        if error is not None:
            raise PipelineError(f"a worker failed: {type(error).__name__}: {error}", INTERNAL)
        code, message = future.result()
        if message:
            raise PipelineError(f"a worker failed: {message}", code)
        yield code


def _report_of(part: str) -> str:
    return os.path.splitext(part)[0] + ".json"


@contextmanager
def _client(address: str, jobs: int) -> Iterator[Client]:
    """A client of the cluster at an address, or of one that lives as long as the block."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        install = "pip install 'dtrepair[distributed]'"
        raise UsageError(f"--distributed: needs the package distributed; {install}") from None
    if address == "local":
        with (
            LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            yield client
        return
    try:
        client = Client(address, timeout="10s")
    except (OSError, ValueError) as error:
        raise UsageError(f"--distributed {address}: no scheduler answers: {error}") from None
    with client:
        yield client


def _workers(client: Client, address: str) -> dict[str, Any]:
    workers: dict[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
    if not workers:
        raise UsageError(f"--distributed {address}: the scheduler has no workers; start some")
    return workers
