"""A transfer from inputs to report: open, match, factor, move every frame, repair, write."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import NDArray

from dtrepair import __version__
from dtrepair.pipeline.clock import Clock
from dtrepair.pipeline.errors import plain_errors
from dtrepair.pipeline.observer import SILENT, Observer, RecordingObserver, stop_if_cancelled, warn
from dtrepair.pipeline.repair.records import clearance_warnings
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.frames import prim_records, refuse_if_none_usable
from dtrepair.pipeline.stages.outputs import FilePath, check_writable, refuse_overwriting
from dtrepair.pipeline.stages.plan import Plan, make_plan
from dtrepair.pipeline.transfer.correspondence import match
from dtrepair.pipeline.transfer.inputs import input_errors
from dtrepair.pipeline.transfer.moving import TransferRun, move_frames
from dtrepair.pipeline.transfer.pair import open_pair
from dtrepair.pipeline.transfer.record import describe
from dtrepair.pipeline.transfer.settings import TransferChoices, TransferSettings
from dtrepair.pipeline.transfer.shapes import ShapeSink
from dtrepair.pipeline.transfer.sinks import open_clip
from dtrepair.pipeline.transfer.solve import FrameTransfer, read_pin_set
from dtrepair.report.record import Report, summarize
from dtrepair.wording import listed

if TYPE_CHECKING:
    from dtrepair.transfer import Transfer


def transfer_stage(
    source: FilePath,
    target: FilePath,
    output: FilePath,
    settings: TransferSettings | None = None,
    *,
    jobs: int | None = None,
    device: str = "auto",
    observer: Observer = SILENT,
    **choices: Unpack[TransferChoices],
) -> Report:
    """Give a target the motion of a source (deformation transfer), and write it.

    Args:
        source: path of an animated stage, or of a rest mesh whose `poses` are given.
        target: path of a stage, over which a layer is written, or of a mesh file, which gives a
            new stage.
        output: path of the stage or layer; it appears whole at the end, or not at all.
        settings: all choices of a run as one object, such as `TransferSettings.from_report`.
        jobs: processors to use; None: all of them.
        device: "auto", "cpu" or "cuda[:N]".
        observer: hears of the run, and may cancel it.
        choices: fields of `TransferSettings`, by name; they replace those of `settings`.

    Raises:
        PipelineError: with the exit code that stands for it, see its subclasses. Cancelled where
            the observer wants the run to end. An older output is intact then.
    """
    chosen = replace(settings or TransferSettings(), **choices)
    source, target, output = os.fspath(source), os.fspath(target), os.fspath(output)
    heard = RecordingObserver(observer)
    with plain_errors(), _prepared(source, target, output, chosen, device, jobs, heard) as run:
        report = _transferred(run)
    return replace(report, warnings=heard.warnings)


def plan_transfer(
    source: FilePath,
    target: FilePath,
    output: FilePath,
    settings: TransferSettings | None = None,
    *,
    device: str = "auto",
    observer: Observer = SILENT,
    **choices: Unpack[TransferChoices],
) -> Plan:
    """Return what `transfer_stage` would do with the same arguments; check them, write nothing."""
    chosen = replace(settings or TransferSettings(), **choices)
    source, target, output = os.fspath(source), os.fspath(target), os.fspath(output)
    with plain_errors(), _prepared(source, target, output, chosen, device, None, observer) as run:
        pair, times = run.pair, run.pair.source.times
        meshes = tuple(
            replace(mesh, path=f"{side.source.name} {mesh.path}")
            for side in (pair.from_meshes, pair.to_meshes)
            for mesh in make_plan(side.source, side.rests, times, output).meshes
        )
        return Plan(meshes, tuple(times.tolist()), output)


@contextmanager
def _prepared(
    source: str,
    target: str,
    output: str,
    settings: TransferSettings,
    device: str,
    jobs: int | None,
    observer: Observer,
) -> Iterator[TransferRun]:
    """Check and open everything; what is not committed within the block is dropped."""
    clock = Clock()
    _check_outputs(source, target, output, settings)
    method = settings.repair.method if settings.repair else "full"
    there, warnings = device_of_method(device, method)
    warn(observer, warnings)
    pair = open_pair(source, target, settings, there)
    warn(observer, pair.warnings)
    open_sink = ShapeSink if settings.options.shapes else open_clip
    recorded = settings.recorded(source, target)
    sink = open_sink(pair.source, pair.target, output, recorded, pair.axes.up)
    try:
        count = len(pair.source.times)
        pins = read_pin_set(pair.to_meshes, settings.options.pin, count)
        clock.lap("read")
        yield TransferRun(
            source, output, settings, recorded, there, jobs, observer, pair, pins, sink, clock
        )
    finally:
        sink.abort()


def files_of(source: str, target: str, settings: TransferSettings) -> tuple[list[str], list[str]]:
    """Return the files that a transfer reads, and those that it writes besides its output."""
    options = settings.options
    read = (options.markers, options.correspondence, options.pin)
    written = (options.save_correspondence, options.registration)
    return (
        [source, target, *settings.poses, *(path for path in read if path)],
        [path for path in written if path is not None],
    )


def _check_outputs(source: str, target: str, output: str, settings: TransferSettings) -> None:
    """Refuse outputs that are inputs, each other, or not writable, before any computing."""
    read, written = files_of(source, target, settings)
    refuse_overwriting(output, *read)
    for index, path in enumerate(written):
        refuse_overwriting(path, *read, others=[output, *written[:index]])
        check_writable(path)


def _transferred(run: TransferRun) -> Report:
    """Match, factor, move every frame, and write."""
    pair, options = run.pair, run.settings.options
    stop_if_cancelled(run.observer)
    found = match(pair, options)
    run.clock.lap("match")
    stop_if_cancelled(run.observer)
    moves = FrameTransfer(_make_transfer(run, found.pairs), pair, run.pins)
    run.clock.lap("factor")
    records, jitter, rest_counts = move_frames(run, moves)
    refuse_if_none_usable(pair.source, records)
    target = listed(pair.to_meshes.paths)
    section, concerns = describe(found, moves, pair.meshes, target)
    late = [*run.late, *found.warnings, *concerns]
    if run.settings.repair is not None:
        late += clearance_warnings(records, run.settings.repair.clearance)
    if rest_count := sum(count or 0 for count in rest_counts):
        late.append(
            f"{pair.target.name}: the rest pose has {rest_count} intersecting triangles of its own"
        )
    run.clock.lap("examine")
    late += run.sink.commit({"counts": summarize(records), "transfer": section.document()})
    run.clock.lap("write")
    run.clock.add(moves.seconds)
    warn(run.observer, late)
    return Report(
        command="transfer",
        version=__version__,
        input=run.source,
        output=run.output,
        device=run.device,
        settings=run.recorded,
        seconds=run.clock.total(),
        prims=prim_records(pair.target, rest_counts),
        frames=tuple(records),
        jitter=jitter,
        attached=run.attached,
        alone_from=run.alone_from,
        transfer=section,
    )


def _make_transfer(run: TransferRun, pairs: NDArray[np.int32]) -> Transfer:
    from dtrepair.transfer import Transfer
    from dtrepair.transfer.rests import rotation_between_rests

    pair, options = run.pair, run.settings.options
    rotation = pair.axes.rotation
    if options.align == "rests":
        with input_errors(prefix="--align rests: "):
            rotation = rotation_between_rests(*pair.meshes, pairs)
    with input_errors():
        return Transfer(
            *pair.meshes[0],
            *pair.meshes[1],
            pairs,
            rotation=rotation,
            up=pair.axes.up,
            scale=options.root_scale,
            snap=options.ground,
        )
