"""A repair from the input to the layer or mesh file over it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import UsageError, plain_errors
from dtrepair.pipeline.observer import SILENT, Observer, warn
from dtrepair.pipeline.repair.chunks import choose_chunk, empty_chunk_warnings
from dtrepair.pipeline.repair.distributed import Workers, measured_jitter, repair_distributed
from dtrepair.pipeline.repair.run import Run, open_journal, repair_here
from dtrepair.pipeline.repair.settings import (
    RepairChoices,
    RepairSettings,
    parse_chunk,
    recorded_settings,
)
from dtrepair.pipeline.stages.bodies import Controls, make_bodies, read_controls
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.frames import mode_warnings
from dtrepair.pipeline.stages.object_settings import recorded
from dtrepair.pipeline.stages.plan import Plan, make_plan
from dtrepair.pipeline.stages.rest import Rest, choose_rests
from dtrepair.pipeline.stages.sinks import Sink, open_sink
from dtrepair.pipeline.stages.sources import Source, open_source
from dtrepair.report.record import Report


def repair_stage(
    stage: str,
    output: str,
    settings: RepairSettings | None = None,
    *,
    resume: bool = False,
    distributed: str | None = None,
    jobs: int | None = None,
    device: str = "auto",
    observer: Observer = SILENT,
    **choices: Unpack[RepairChoices],
) -> Report:
    """Repair every selected frame of a stage or mesh file; write a layer over it, or a mesh file.

    Args:
        stage: path of a USD stage or mesh file.
        output: path of the layer or mesh file; it appears whole at the end, or not at all.
        settings: all choices of a run as one object, such as `RepairSettings.from_report`.
        resume: go on with an interrupted run of the same settings, from the journal beside output.
        distributed: address of a Dask scheduler whose workers repair a chunk each, or "local".
        jobs: processors to use; None: all of them.
        device: "auto", "cpu" or "cuda[:N]".
        observer: hears of the run, and may cancel it.
        choices: fields of `RepairSettings`, by name; they replace those of `settings`.

    Raises:
        PipelineError: with the exit code that stands for it, see its subclasses. Cancelled where
            the observer wants the run to end. An older output is intact then.
    """
    chosen = replace(settings or RepairSettings(), **choices)
    _refuse_together(chosen, resume=resume, distributed=distributed)
    with plain_errors(), _prepared(stage, output, chosen, device, jobs, observer) as prepared:
        source = prepared.source
        bodies = make_bodies(
            source, prepared.rests, prepared.controls, observer, mode=chosen.options.mode
        )
        if distributed is not None and len(source.times) > 1:
            prepared.sink.abort()
            return _distributed(prepared, distributed, observer)
        journal = open_journal(prepared.run, bodies, observer, resume=resume)
        warn(observer, journal.warnings if journal is not None else ())
        return repair_here(
            prepared.run, source, prepared.rests, bodies, prepared.sink, observer, journal
        )


def plan_repair(
    stage: str,
    output: str,
    settings: RepairSettings | None = None,
    *,
    resume: bool = False,
    distributed: str | None = None,
    device: str = "auto",
    observer: Observer = SILENT,
    **choices: Unpack[RepairChoices],
) -> Plan:
    """Return what `repair_stage` would do with the same arguments; check them, write nothing."""
    chosen = replace(settings or RepairSettings(), **choices)
    _refuse_together(chosen, resume=resume, distributed=distributed)
    with plain_errors(), _prepared(stage, output, chosen, device, None, observer) as prepared:
        return make_plan(
            prepared.source,
            prepared.rests,
            prepared.written,
            output,
            prepared.controls.settings,
        )


def _refuse_together(settings: RepairSettings, *, resume: bool, distributed: str | None) -> None:
    if distributed is not None and (settings.chunk is not None or resume):
        raise UsageError("--distributed: not with --chunk or --resume; leave one out")


@dataclass(frozen=True)
class _Prepared:
    """A run with its inputs read, and its output opened."""

    run: Run
    device: str
    settings: RepairSettings
    source: Source
    controls: Controls
    rests: list[Rest]
    sink: Sink

    @property
    def written(self) -> NDArray[np.float64]:
        """Times (T,) of the frames that the run is to write."""
        assert self.run.chunk is not None
        return self.run.chunk.times[self.run.chunk.written]


@contextmanager
def _prepared(
    stage: str,
    output: str,
    settings: RepairSettings,
    device: str,
    jobs: int | None,
    observer: Observer,
) -> Iterator[_Prepared]:
    """Read the inputs, open the output, and drop what is not committed within the block."""
    there, warnings = device_of_method(device, settings.options.method)
    warn(observer, warnings)
    run = Run(stage, output, there, settings.options, jobs, settings.single)
    source = open_source(stage, settings.selection, collider=settings.objects.collider)
    warn(observer, [*source.warnings, *mode_warnings(source, settings.options.mode)])
    controls = _controls(run, source, settings, observer)
    run.settings = _recorded(source, settings, controls)
    sink = open_sink(source, output, run.settings)
    try:
        run.lap("read")
        rests = choose_rests(source, settings.rest, device=run.device)
        run.chunk = choose_chunk(source, parse_chunk(settings.chunk), alone=run.alone)
        warn(observer, empty_chunk_warnings(run.chunk, settings.chunk))
        yield _Prepared(run, device, settings, source, controls, rests, sink)
    finally:
        sink.abort()


def _controls(run: Run, source: Source, settings: RepairSettings, observer: Observer) -> Controls:
    """What each object is told to do; refused where it has no effect."""
    controls = read_controls(source, settings.objects, settings.tables)
    warn(observer, controls.warnings)
    run.ignored = controls.ignored
    if settings.options.method == "paper":
        for option, given in (
            ("--direction", any(way is not None for way in controls.directions)),
            ("--rigid", any(own.rigid for own in controls.settings)),
        ):
            if given:
                raise UsageError(f"{option}: has no effect with --method paper; leave it out")
    return controls


def _recorded(source: Source, settings: RepairSettings, controls: Controls) -> dict[str, object]:
    """What the output keeps of the choices."""
    more = {
        "rest": settings.rest,
        "objects": recorded(source, controls.settings),
        "chunk": settings.chunk,
    }
    return recorded_settings(settings.selection, settings.objects, settings.options, more)


def _distributed(prepared: _Prepared, address: str, observer: Observer) -> Report:
    """Repair on several workers; the report is of the whole run."""
    from dtrepair.repair.parallel.worker_pool import available_processors

    run, settings = prepared.run, prepared.settings
    jobs = run.jobs or available_processors()
    workers = Workers(address, jobs, prepared.device)
    report = repair_distributed(
        repair_stage, prepared.source, run.output, settings, workers, observer
    )
    result = open_source(run.output, settings.selection, collider=settings.objects.collider)
    run.lap("total")
    seconds = {**report.seconds, "total": run.seconds["total"]}
    jitter = measured_jitter(prepared.source, result)
    return replace(report, output=run.output, seconds=seconds, jitter=jitter)
