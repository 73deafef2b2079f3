"""A repair from the input to the layer or mesh file over it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Unpack

from dtrepair.pipeline.clock import Clock
from dtrepair.pipeline.errors import UsageError, plain_errors
from dtrepair.pipeline.modelled.parts import tell_sets
from dtrepair.pipeline.modelled.worn import tell_worn
from dtrepair.pipeline.observer import (
    SILENT,
    ModelledFound,
    Observer,
    PassingFound,
    RecordingObserver,
    stop_if_cancelled,
    warn,
)
from dtrepair.pipeline.repair.chunks import choose_chunk, empty_chunk_warnings
from dtrepair.pipeline.repair.cluster import Workers
from dtrepair.pipeline.repair.corrections import CorrectionSink
from dtrepair.pipeline.repair.distributed import measured_jitter, repair_distributed
from dtrepair.pipeline.repair.run import (
    Prepared,
    Run,
    open_journal,
    refuse_wide_clearance,
    repair_here,
    tell_before,
)
from dtrepair.pipeline.repair.settings import (
    OutputOptions,
    RepairChoices,
    RepairSettings,
    parse_chunk,
)
from dtrepair.pipeline.stages.bodies import Controls, make_bodies, read_controls
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.frames import mode_warnings
from dtrepair.pipeline.stages.object_settings import recorded
from dtrepair.pipeline.stages.outputs import FilePath
from dtrepair.pipeline.stages.plan import Plan, make_plan
from dtrepair.pipeline.stages.rest import choose_rests, thin_warnings
from dtrepair.pipeline.stages.sinks import Sink, open_sink
from dtrepair.pipeline.stages.sources import Source, open_source
from dtrepair.repair.options import RepairOptions
from dtrepair.report.record import Report
from dtrepair.wording import frames_named


def repair_stage(
    stage: FilePath,
    output: FilePath,
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
        jobs: processors to use; None: all of them. More than 1 may fork processes.
        device: "auto", "cpu" or "cuda[:N]".
        observer: hears of the run, and may cancel it.
        choices: fields of `RepairSettings`, by name; they replace those of `settings`.

    Raises:
        PipelineError: with the exit code that stands for it, see its subclasses. Cancelled where
            the observer wants the run to end. An older output is intact then.
    """
    chosen = replace(settings or RepairSettings(), **choices)
    _refuse_together(chosen, resume=resume, distributed=distributed)
    heard = RecordingObserver(observer)
    with (
        plain_errors(),
        _prepared(os.fspath(stage), os.fspath(output), chosen, device, jobs, heard) as prepared,
    ):
        if distributed is not None and len(prepared.source.times) > 1:
            workers = Workers(distributed, jobs, device)
            report = _distributed(prepared, chosen, workers, heard)
        else:
            journal = open_journal(prepared, heard, resume=resume)
            report = repair_here(prepared, heard, journal)
    return replace(report, warnings=heard.warnings)


def plan_repair(
    stage: FilePath,
    output: FilePath,
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
    with (
        plain_errors(),
        _prepared(os.fspath(stage), os.fspath(output), chosen, device, None, observer) as prepared,
    ):
        chunk = prepared.chunk
        tell_before(prepared, observer)
        return make_plan(
            prepared.source,
            prepared.rests,
            chunk.times[chunk.written],
            prepared.output,
            prepared.controls.settings,
            chosen.objects,
        )


@contextmanager
def _prepared(
    stage: str,
    output: str,
    settings: RepairSettings,
    device: str,
    jobs: int | None,
    observer: Observer,
) -> Iterator[Prepared]:
    """Read the inputs, open the output, and drop what is not committed within the block."""
    options, clock = settings.options, Clock()
    there, warnings = device_of_method(device, options.method)
    warn(observer, warnings)
    source = open_source(stage, settings.selection, collider=settings.objects.collider)
    warn(observer, [*source.warnings, *mode_warnings(source, options.mode)])
    controls = read_controls(source, settings.objects, settings.tables)
    warn(observer, controls.warnings)
    _refuse_without_effect(options, controls)
    kept = {**settings.recorded, "objects": recorded(source, controls.settings)}
    run = Run(
        stage,
        output,
        there,
        options,
        jobs,
        settings.single,
        controls.ignored,
        controls.told,
        kept,
        clock,
    )
    sink = _open_output(source, output, kept, settings.writing)
    try:
        clock.lap("read")
        stop_if_cancelled(observer)
        rests = choose_rests(source, settings.rest, device=there)
        placed = make_bodies(source, rests, controls, mode=options.mode)
        refuse_wide_clearance(source, options, placed.bodies)
        warn(observer, thin_warnings(source, rests, controls.settings, options.clearance))
        stop_if_cancelled(observer)
        chunk = choose_chunk(source, parse_chunk(settings.chunk), alone=run.alone)
        warn(observer, empty_chunk_warnings(chunk, settings.chunk))
        warn(observer, _only_frames_warnings(source, settings))
        yield Prepared(run, source, controls, rests, placed, chunk, output, sink)
    finally:
        sink.abort()


def _only_frames_warnings(source: Source, settings: RepairSettings) -> list[str]:
    """Say what a layer of the chosen frames alone does to all others, or that there are none."""
    if not settings.writing.only_frames:
        return []
    if len(source.times) < len(source.all_times):
        nearest = "it" if len(source.times) == 1 else "the nearest of these"
        layer = "the layer" if settings.chunk is None else "the joined layer"
        return [
            f"--only-frames: {layer} holds {frames_named(source.times.tolist())} alone; in all "
            f"others, what it changes stays as in {nearest}"
        ]
    if settings.selection.frames is None and settings.chunk is None:
        return ["--only-frames: has no effect, as all frames are chosen; choose some by --frames"]
    return []


def _open_output(
    source: Source, output: str, kept: dict[str, object], writing: OutputOptions
) -> Sink:
    """Check the output and open it, before anything is computed."""
    if writing.shapes or writing.delta:
        return CorrectionSink(source, output, kept, "shapes" if writing.shapes else "offsets")
    return open_sink(source, output, kept, normals=writing.normals, only_frames=writing.only_frames)


def _refuse_together(settings: RepairSettings, *, resume: bool, distributed: str | None) -> None:
    if distributed is not None and (settings.chunk is not None or resume):
        raise UsageError("--distributed: not with --chunk or --resume; leave one out")
    if distributed is not None and (settings.writing.shapes or settings.writing.delta):
        raise UsageError("--distributed: not with --shapes or --delta, which need all frames")


def _refuse_without_effect(options: RepairOptions, controls: Controls) -> None:
    """Refuse what is asked of single objects, and the published method does not have."""
    if options.method == "paper" and any(own.rigid for own in controls.settings):
        raise UsageError("--rigid: has no effect with --method paper; leave it out")


def _distributed(
    prepared: Prepared, settings: RepairSettings, workers: Workers, observer: RecordingObserver
) -> Report:
    """Repair on several workers; the report is of the whole run."""
    source, output, clock = prepared.source, prepared.output, prepared.run.clock
    prepared.sink.abort()
    report = repair_distributed(repair_stage, source, output, settings, workers, observer)
    result = open_source(output, settings.selection, collider=settings.objects.collider)
    jitter = measured_jitter(source, result)
    tell_sets(observer, source)
    if report.attached:
        observer.remark(ModelledFound(report.attached))
    if report.passing:
        observer.remark(PassingFound(report.passing))
    tell_worn(observer, report.worn)
    # What the workers told nobody else.
    warn(observer, [text for text in report.warnings if text not in observer.warnings])
    seconds = {**report.seconds, "total": clock.total()["total"]}
    return replace(report, output=output, seconds=seconds, jitter=jitter)
