"""Key poses from a stage to the layer over it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Unpack

from dtrepair import __version__
from dtrepair.keyposes.search import clean_in_betweens, verify_in_betweens
from dtrepair.keyposes.spans import KeyPoses
from dtrepair.pipeline.clock import Clock
from dtrepair.pipeline.errors import UsageError, plain_errors
from dtrepair.pipeline.keyposes.findings import key_findings
from dtrepair.pipeline.keyposes.record import in_betweens
from dtrepair.pipeline.keyposes.settings import KeyposeChoices, KeyposeSettings
from dtrepair.pipeline.keyposes.solve import StageKeys
from dtrepair.pipeline.modelled.parts import tell_modelled, tell_props
from dtrepair.pipeline.modelled.worn import tell_worn, worn_records
from dtrepair.pipeline.observer import (
    SILENT,
    FrameDone,
    Observer,
    Progress,
    RecordingObserver,
    SpansDone,
    stop_if_cancelled,
    warn,
)
from dtrepair.pipeline.repair.collider_contacts import ColliderContacts, colliders_of
from dtrepair.pipeline.repair.records import clearance_warnings
from dtrepair.pipeline.repair.run import Run, make_repairer, refuse_wide_clearance
from dtrepair.pipeline.repair.solve import FrameRepairer
from dtrepair.pipeline.stages.bodies import Controls, PlacedBodies, make_bodies, read_controls
from dtrepair.pipeline.stages.devices import device_of_method
from dtrepair.pipeline.stages.frames import mode_warnings, prim_records, refuse_if_none_usable
from dtrepair.pipeline.stages.object_settings import recorded
from dtrepair.pipeline.stages.outputs import FilePath
from dtrepair.pipeline.stages.plan import Plan, make_plan
from dtrepair.pipeline.stages.rest import Rest, choose_rests, rest_warnings, thin_warnings
from dtrepair.pipeline.stages.sinks import Sink, open_sink
from dtrepair.pipeline.stages.sources import StageSource, is_stage, open_source
from dtrepair.report.findings import warnings_of
from dtrepair.report.record import FrameRecord, Report, summarize
from dtrepair.wording import frames_named


def repair_keyposes(
    stage: FilePath,
    output: FilePath | None = None,
    settings: KeyposeSettings | None = None,
    *,
    jobs: int | None = None,
    device: str = "auto",
    observer: Observer = SILENT,
    **choices: Unpack[KeyposeChoices],
) -> Report:
    """Repair the keys of a stage and make the poses between them clean; write a layer over it.

    Keys are the samples of the points, of skins those of the joints, and of the transforms where
    several meshes meet; of animation with a sample on every whole frame those that are named one by
    one. Where in-betweens intersect, keys are moved a little, or as few as possible are added.

    Args:
        stage: path of a USD stage.
        output: path of the layer, which appears whole at the end, or not at all; None: only count
            what intersects, and write nothing.
        settings: all choices of a run as one object, such as `KeyposeSettings.from_report`.
        jobs: processors to use; None: all of them.
        device: "auto", "cpu" or "cuda[:N]".
        observer: hears of the run, and may cancel it.
        choices: fields of `KeyposeSettings`, by name; they replace those of `settings`.

    Raises:
        PipelineError: with the exit code that stands for it, see its subclasses. Cancelled where
            the observer wants the run to end. An older output is intact then.
    """
    chosen, path = replace(settings or KeyposeSettings(), **choices), _path_of(output)
    heard = RecordingObserver(observer)
    with (
        plain_errors(),
        _prepared(os.fspath(stage), path, chosen, device, jobs, heard) as prepared,
    ):
        report = _solved(prepared, heard)
    return replace(report, warnings=heard.warnings)


def plan_keyposes(
    stage: FilePath,
    output: FilePath | None = None,
    settings: KeyposeSettings | None = None,
    *,
    device: str = "auto",
    observer: Observer = SILENT,
    **choices: Unpack[KeyposeChoices],
) -> Plan:
    """Return what `repair_keyposes` would do with the same arguments; check them, write nothing."""
    chosen, path = replace(settings or KeyposeSettings(), **choices), _path_of(output)
    with (
        plain_errors(),
        _prepared(os.fspath(stage), path, chosen, device, None, observer) as prepared,
    ):
        source, each = prepared.source, prepared.controls.settings
        repairer, _ = _told_repairer(prepared, observer)
        tell_worn(observer, worn_records(source, repairer.repairer.scene))
        return make_plan(source, prepared.rests, source.times, path, each, chosen.objects)


def _path_of(output: FilePath | None) -> str | None:
    return None if output is None else os.fspath(output)


@dataclass(frozen=True)
class _Prepared:
    """A run with its input read, and its output opened."""

    run: Run
    settings: KeyposeSettings
    source: StageSource
    controls: Controls
    rests: list[Rest]
    placed: PlacedBodies
    sink: Sink | None


@contextmanager
def _prepared(
    stage: str,
    output: str | None,
    settings: KeyposeSettings,
    device: str,
    jobs: int | None,
    observer: Observer,
) -> Iterator[_Prepared]:
    """Read the input, open the output, and drop what is not committed within the block."""
    options = settings.options
    there, warnings = device_of_method(device, options.method)
    warn(observer, warnings)
    clock = Clock()
    source = _open(stage, settings)
    warn(observer, [*source.warnings, *mode_warnings(source, options.mode)])
    controls = read_controls(source, settings.objects, settings.tables)
    warn(observer, controls.warnings)
    kept = {**settings.recorded, "objects": recorded(source, controls.settings)}
    run = Run(
        stage,
        output,
        there,
        options,
        jobs,
        True,
        controls.ignored,
        controls.told,
        kept,
        clock,
    )
    sink = None if output is None else open_sink(source, output, kept)
    try:
        clock.lap("read")
        rests = choose_rests(source, settings.rest, device=there)
        placed = make_bodies(source, rests, controls, mode=options.mode)
        refuse_wide_clearance(source, options, placed.bodies)
        warn(observer, thin_warnings(source, rests, controls.settings, options.clearance))
        yield _Prepared(run, settings, source, controls, rests, placed, sink)
    finally:
        if sink is not None:
            sink.abort()


def _open(stage: str, settings: KeyposeSettings) -> StageSource:
    """Return the stage, which must have time samples."""
    if not is_stage(stage):
        raise UsageError(f"{stage}: is not a USD stage: only stages have keys")
    source = open_source(
        stage, settings.selection, collider=settings.objects.collider, frames="key poses"
    )
    assert isinstance(source, StageSource)
    if math.isnan(source.times[0]):
        raise UsageError(f"{stage}: no mesh has time samples; use dtrepair repair")
    return source


def _told_repairer(
    prepared: _Prepared, observer: Observer
) -> tuple[FrameRepairer, list[int | None]]:
    """Return what `make_repairer` does; tell what it takes as modelled and as props."""
    run, source, rests = prepared.run, prepared.source, prepared.rests
    repairer, rest_counts = make_repairer(run, source, rests, prepared.placed.bodies)
    warn(observer, rest_warnings(source, rests, rest_counts, prepared.controls.settings))
    unclear = prepared.placed.met
    tell_modelled(observer, repairer.modelled, asked=run.told.attached, unclear=unclear)
    tell_props(observer, repairer.repairer.scene)
    return repairer, rest_counts


def _solved(prepared: _Prepared, observer: Observer) -> Report:
    """Repair the keys, then the in-betweens; write; return the report."""
    run, source, sink = prepared.run, prepared.source, prepared.sink
    controls, mode = prepared.controls, prepared.settings.options.mode
    repairer, rest_counts = _told_repairer(prepared, observer)
    run.clock.lap("factor")
    rigid = [bool(own.rigid) for own in controls.settings]
    keys = StageKeys(source, repairer, rigid, lambda: stop_if_cancelled(observer))
    records = _repair_keys(keys, observer, only_count=sink is None)
    among = colliders_of(source, controls, mode, rest_counts)
    warn(observer, [*_collider_warnings(among, keys), *_lacking_warnings(keys)])
    repaired = sink is not None and any(r.before and r.before.pairs for r in records.values())
    worn = worn_records(source, repairer.repairer.scene) if repaired else ()
    tell_worn(observer, worn)
    refuse_if_none_usable(source, list(records.values()))
    run.clock.lap("solve")
    found = _search(prepared, keys, observer)
    run.clock.lap("in-betweens")
    added = {time: None for span in found.spans for time in span.added}
    frames = tuple(
        keys.record(record, time, found.tracks)
        for time, record in sorted({**records, **added}.items())
    )
    findings = key_findings(source, keys, found, prepared.settings.keys.interpolation)
    warn(observer, clearance_warnings(frames, run.options.clearance) + warnings_of(findings))
    if sink is not None:
        keys.write(found.tracks, sink)
        warn(observer, sink.commit({"counts": summarize(frames)}))
        run.clock.lap("write")
    return Report(
        command="keyposes",
        version=__version__,
        input=run.input,
        output=run.output,
        device=run.device,
        settings=run.settings,
        seconds=run.clock.total(),
        prims=prim_records(source, rest_counts),
        frames=frames,
        attached=repairer.modelled.attached,
        passing=repairer.modelled.passing,
        worn=worn,
        findings=findings,
        keyposes=in_betweens(found, prepared.settings.keys.interpolation, keys.skipped),
    )


def _collider_warnings(among: ColliderContacts, keys: StageKeys) -> tuple[str, ...]:
    """Return what there is to tell of colliders that intersect at keys."""
    for time, count in keys.counts.items():
        among.see(time, count)
    return among.warnings


def _lacking_warnings(keys: StageKeys) -> tuple[str, ...]:
    """Return which frames between keys have no points, as their spans are not looked at."""
    if not keys.lacking:
        return ()
    one = len(keys.lacking) == 1
    return (
        f"{frames_named(keys.lacking)} between keys cannot be used, "
        f"so that {'its span is' if one else 'their spans are'} not looked at: "
        f"{next(iter(keys.lacking.values()))}",
    )


def _repair_keys(
    keys: StageKeys, observer: Observer, *, only_count: bool
) -> dict[float, FrameRecord]:
    """Repair each key for itself, or count it; the records by time."""
    records: dict[float, FrameRecord] = {}
    with Progress(observer, "keys", len(keys.selected)) as progress:
        for time in progress.over(keys.selected):
            done = keys.check_key(time) if only_count else keys.repair_key(time)
            records[time] = done.record
            observer.remark(FrameDone(done.record, done.error))
    return records


def _search(prepared: _Prepared, keys: StageKeys, observer: Observer) -> KeyPoses:
    """Look at the in-betweens, and mend them where there is an output."""
    from dtrepair.repair.parallel.worker_pool import available_processors

    total, only_count = len(keys.spans), prepared.sink is None
    with Progress(observer, "in-betweens", total) as progress:

        def tell(done: int) -> None:
            progress.ahead(done)
            observer.remark(SpansDone(done, total))

        search = verify_in_betweens if only_count else partial(clean_in_betweens, progress=tell)
        return search(
            keys.tracks,
            keys.spans,
            keys,
            options=prepared.settings.keys,
            jobs=prepared.run.jobs or available_processors(),
            check=lambda: stop_if_cancelled(observer),
        )
