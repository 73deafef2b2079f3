"""The work of a repair: its solver, its journal, frames into the sink."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dtrepair import __version__
from dtrepair.pipeline.clock import Clock
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.modelled.parts import tell_modelled, tell_props
from dtrepair.pipeline.modelled.worn import tell_worn, worn_records
from dtrepair.pipeline.observer import FrameDone, Observer, Progress, ProgressKept, Trouble, warn
from dtrepair.pipeline.repair.chunks import Chunk
from dtrepair.pipeline.repair.collider_contacts import ColliderContacts, colliders_of
from dtrepair.pipeline.repair.corrections import CorrectionSink
from dtrepair.pipeline.repair.journal import Journal, hash_of_run
from dtrepair.pipeline.repair.motion import Motion
from dtrepair.pipeline.repair.records import clearance_warnings
from dtrepair.pipeline.repair.recount import settle_shapes
from dtrepair.pipeline.repair.solve import FrameRepairer, repair_frames
from dtrepair.pipeline.stages.bodies import Controls, PlacedBodies, in_units_of_frames
from dtrepair.pipeline.stages.frames import (
    HiddenMeshes,
    make_counter,
    prim_records,
    read_frames,
    refuse_if_none_usable,
)
from dtrepair.pipeline.stages.matching import CalledPairs
from dtrepair.pipeline.stages.rest import Rest, rest_warnings
from dtrepair.pipeline.stages.sinks import Sink
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.findings import FindingKind, MotionFinding, warnings_of
from dtrepair.report.parts import WornRecord
from dtrepair.report.record import FrameRecord, Report, summarize

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions
    from dtrepair.repair.scene.bodies import Body
    from dtrepair.repair.solution_cache import Memory


@dataclass(frozen=True)
class Run:
    """What a run is about: what it computes on, what it keeps of its choices, and its clock.

    output: None where it only counts. ignored: pairs of meshes whose contacts do not count;
    told: pairs of meshes that the user calls attached or detached.
    """

    input: str
    output: str | None
    device: str
    options: RepairOptions
    jobs: int | None
    alone: bool
    ignored: tuple[tuple[int, int], ...]
    told: CalledPairs
    settings: Mapping[str, Any]
    clock: Clock


@dataclass(frozen=True)
class Prepared:
    """A repair with its inputs read and placed, its frames known, and its output opened."""

    run: Run
    source: Source
    controls: Controls
    rests: list[Rest]
    placed: PlacedBodies
    chunk: Chunk
    output: str
    sink: Sink


@dataclass(frozen=True)
class _Outcome:
    """The records of all frames, how corrections go in time, and what was taken as worn."""

    records: list[FrameRecord]
    motion: Motion
    worn: tuple[WornRecord, ...]


def open_journal(prepared: Prepared, observer: Observer, *, resume: bool) -> Journal | None:
    """The journal of a run; None where a run is a single step, solved wholly or not at all."""
    run, times = prepared.run, prepared.chunk.times
    if len(times) <= 1:
        return None
    # Single poses need no stages of clips.
    from dtrepair.repair.clip.clip_options import ClipOptions

    journal = Journal(
        prepared.output,
        hash_of_run(run.settings, run.device, prepared.placed.bodies, times),
        resume=resume,
        on_kept=lambda entries: observer.remark(ProgressKept(entries)),
    )
    single = len(times) <= (1 if run.alone else ClipOptions().window)
    if resume or not single:  # what was kept of a longer run is gone
        warn(observer, journal.warnings)
    return None if single else journal


def repair_here(prepared: Prepared, observer: Observer, journal: Journal | None) -> Report:
    """Repair all frames into the sink, commit it, and return the report."""
    run, source, rests = prepared.run, prepared.source, prepared.rests
    repairer, rest_counts = _told_repairer(prepared, observer, journal)
    hidden = HiddenMeshes(source)
    among = colliders_of(source, prepared.controls, run.options.mode, rest_counts)
    outcome = _repair_frames(prepared, repairer, hidden, among, observer)
    records, sink, told = outcome.records, prepared.sink, list[str]()
    if isinstance(sink, CorrectionSink) and sink.form == "shapes":
        records, told = settle_shapes(sink, repairer, records)
    if "chunk" not in run.settings:  # of a farm the other chunks may be fine, and want this one
        refuse_if_none_usable(source, records)
    written = sink.commit({"counts": summarize(records)})
    if isinstance(sink, CorrectionSink):
        sink.tell(observer)
    findings = _findings(run, outcome)
    warnings = (*repairer.warnings, *hidden.warnings, *among.warnings, *told, *written)
    close = clearance_warnings(records, run.options.clearance)
    warnings = (*warnings, *close, *warnings_of(findings))
    if journal is not None:
        warnings = (*warnings, *journal.failures)
        journal.remove()
    warn(observer, warnings)
    run.clock.lap("write")
    return Report(
        command="repair",
        version=__version__,
        input=run.input,
        output=run.output,
        device=run.device,
        settings=_reported(run, rests),
        seconds=run.clock.total(),
        prims=prim_records(source, rest_counts),
        frames=tuple(records),
        jitter=outcome.motion.jitter,
        attached=repairer.modelled.attached,
        passing=repairer.modelled.passing,
        worn=outcome.worn,
        findings=findings,
        alone_from=repairer.alone_from,
    )


def tell_before(prepared: Prepared, observer: Observer) -> None:
    """Tell what a repair takes as modelled, as props and as worn, and repair nothing."""
    repairer, _ = _told_repairer(prepared, observer)
    tell_worn(observer, worn_records(prepared.source, repairer.repairer.scene))


def _told_repairer(
    prepared: Prepared, observer: Observer, journal: Journal | None = None
) -> tuple[FrameRepairer, list[int | None]]:
    """Return what `make_repairer` does; tell what it takes as modelled and as props."""
    from dtrepair.pipeline.modelled.references import untold_contacts

    run, source, rests = prepared.run, prepared.source, prepared.rests
    repairer, rest_counts = make_repairer(run, source, rests, prepared.placed.bodies, journal)
    run.clock.lap("factor")
    met = list[str]()
    if run.options.rest_contacts == "auto" and run.options.method == "full":
        met = untold_contacts(source, rests, ignored=run.ignored, told=run.told)
    settings = prepared.controls.settings
    # One of them names --rest, which would help with both.
    warn(observer, rest_warnings(source, rests, rest_counts, settings, advise=not met))
    tell_modelled(observer, repairer.modelled, asked=run.told.attached, unclear=prepared.placed.met)
    tell_props(observer, repairer.repairer.scene)
    warn(observer, met)
    return repairer, rest_counts


def _findings(run: Run, outcome: _Outcome) -> tuple[MotionFinding, ...]:
    """What is to be looked at; of what was asked for to be so nothing."""
    wanted = set(FindingKind)
    if run.alone:  # who asks for frames by themselves does not ask for steady ones
        wanted -= {FindingKind.JUMPS, FindingKind.BREAKS_OFF}
    if run.settings.get("only_frames"):  # there are none beside them
        wanted -= {FindingKind.BREAKS_OFF}
    found = outcome.motion.findings({own.over.path for own in outcome.worn})
    return tuple(own for own in found if own.kind in wanted)


def _repair_frames(
    prepared: Prepared,
    repairer: FrameRepairer,
    hidden: HiddenMeshes,
    among: ColliderContacts,
    observer: Observer,
) -> _Outcome:
    """Repair all frames into the sink; what is worn is looked for where one has contacts."""
    source, chunk, clock = prepared.source, prepared.chunk, prepared.run.clock
    records: list[FrameRecord] = []
    worn: tuple[WornRecord, ...] | None = None
    motion = Motion(source)
    given = hidden.among(read_frames(source, chunk.times))
    with (
        Progress(observer, "repairing", len(chunk.times)) as progress,
        closing(repair_frames(given, repairer, see=among.see)) as frames,
    ):
        repairer.progress = progress.ahead
        for repaired, written in progress.over(zip(frames, chunk.written, strict=True)):
            if not written:
                continue
            for index, points in enumerate(repaired.points):
                prepared.sink.put(index, repaired.frame.time, points)
            motion.add(repaired.frame.time, repaired.frame.spaces, repaired.spaces)
            records.append(repaired.record)
            clock.add(repaired.seconds)
            observer.remark(FrameDone(repaired.record, repaired.error))
            before = repaired.record.before
            if worn is None and before is not None and before.pairs:
                # Known only now: clean frames do not need to know what is worn.
                worn = worn_records(source, repairer.repairer.scene)
                tell_worn(observer, worn)
    if repairer.error is not None:
        observer.remark(Trouble(repairer.error))
    clock.skip()
    return _Outcome(records, motion, worn or ())


def _reported(run: Run, rests: list[Rest]) -> dict[str, Any]:
    """The choices of a run for its report, which tells where the rest poses come from."""
    asked = {"rest_option": run.settings["rest"]} if "rest" in run.settings else {}
    rest = [rest.origin for rest in rests]
    return {**run.settings, "rest": rest, **asked, "alone": run.alone}


def make_repairer(
    run: Run,
    source: Source,
    rests: list[Rest],
    bodies: list[Body],
    memory: Memory | None = None,
    *,
    told_by_rest: bool = False,
) -> tuple[FrameRepairer, list[int | None]]:
    """Build the solver and the counter, once for all frames; count the rests' own intersections.

    told_by_rest: meshes that do not move at all are known to lie as they were modelled together.

    Raises:
        UsageError: a clearance too wide for the rest poses.
    """
    from dtrepair.intersect.scene_counts import SceneCounter
    from dtrepair.pipeline.modelled.references import layer_poses, modelled_references
    from dtrepair.repair.repairer import SceneRepairer
    from dtrepair.repair.scene.sub_scene import attachments_of

    options = in_units_of_frames(source, run.options)
    refuse_wide_clearance(source, run.options, bodies)
    references = modelled_references(
        source, rests, ignored=run.ignored, told=run.told, told_by_rest=told_by_rest
    )
    scene = SceneRepairer(
        bodies,
        options=options,
        device=run.device,
        ignore=run.ignored,
        references=references,
        layer_poses=layer_poses(source, rests),
    )
    mode = run.options.mode
    counter = make_counter(
        source,
        mode=mode,
        ignored=run.ignored,
        device=run.device,
        attachments=scene.scene.attachments,
    )
    rest_counts: list[int | None] = []
    for index, (mesh, rest) in enumerate(zip(source.meshes, rests, strict=True)):
        own = SceneCounter(
            [rest.points],
            [mesh.faces],
            device=run.device,
            attachments=attachments_of(scene.scene, index),
        )
        rest_counts.append(own([rest.points]).total.triangles)
    return (
        FrameRepairer(source, scene, counter, jobs=run.jobs, alone=run.alone, memory=memory),
        rest_counts,
    )


def refuse_wide_clearance(source: Source, options: RepairOptions, bodies: list[Body]) -> None:
    """Raise UsageError where the clearance is too wide for the rest poses of bodies."""
    from dtrepair.repair.scene.bodies import widest_clearance

    told, clearance = options.clearance, in_units_of_frames(source, options).clearance
    most = widest_clearance(np.concatenate([np.asarray(body.rest) for body in bodies]))
    if clearance > most > 0.0:
        raise UsageError(
            f"--clearance {told:g}: expected at most {most * told / clearance:.4g}, a twentieth of "
            "the diagonal of all rest poses; a thousandth is plenty"
        )
