"""A run of `dtrepair repair`: its clock, its solver, its journal, frames into the sink."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from dtrepair import __version__
from dtrepair.numerics.jitter_meter import JitterMeter
from dtrepair.pipeline.observer import FrameDone, Observer, Progress, ProgressKept, Trouble, warn
from dtrepair.pipeline.repair.chunks import Chunk
from dtrepair.pipeline.repair.journal import Journal, hash_of_run
from dtrepair.pipeline.repair.solve import FrameRepairer, Repaired, repair_frames
from dtrepair.pipeline.stages.bodies import in_units_of_frames
from dtrepair.pipeline.stages.frames import (
    make_counter,
    prim_records,
    read_frames,
    refuse_if_none_usable,
)
from dtrepair.pipeline.stages.rest import Rest, rest_warnings
from dtrepair.pipeline.stages.sinks import Sink
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.record import FrameRecord, Report, summarize

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions
    from dtrepair.repair.scene.bodies import Body
    from dtrepair.repair.solution_cache import Memory


@dataclass
class Run:
    """What a run is about, and its clock: `seconds` of each part."""

    input: str
    output: str
    device: str
    options: RepairOptions
    jobs: int | None
    alone: bool
    chunk: Chunk | None = None
    ignored: tuple[tuple[int, int], ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    start: float = field(default_factory=clock.perf_counter)
    last: float = field(default_factory=clock.perf_counter)

    def lap(self, name: str) -> None:
        """Give the time since the last lap to a part."""
        now = clock.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self.last
        self.last = now


def open_journal(
    run: Run, bodies: list[Body], observer: Observer, *, resume: bool
) -> Journal | None:
    """The journal of a run; None where a run is a single step, solved wholly or not at all."""
    from dtrepair.repair.clip.animation import ClipOptions

    assert run.chunk is not None
    times = run.chunk.times
    run_hash = hash_of_run(run.settings, run.device, bodies, times)
    journal = Journal(
        run.output,
        run_hash,
        resume=resume,
        on_kept=lambda entries: observer.remark(ProgressKept(entries)),
    )
    return None if len(times) <= (1 if run.alone else ClipOptions().window) else journal


def repair_here(
    run: Run,
    source: Source,
    rests: list[Rest],
    bodies: list[Body],
    sink: Sink,
    observer: Observer,
    journal: Journal | None,
) -> Report:
    """Repair all frames into the sink, commit it, and return the report."""
    repairer, rest_counts = make_repairer(run, source, rests, bodies, journal)
    run.lap("factor")
    warn(observer, rest_warnings(source, rests, rest_counts))
    records: list[FrameRecord] = []
    meter = [JitterMeter() for _ in source.meshes]
    assert run.chunk is not None
    times = run.chunk.times
    progress = Progress(observer, "repairing", len(times))
    repairer.progress = progress.ahead
    frames = zip(
        repair_frames(read_frames(source, times), repairer), run.chunk.written, strict=True
    )
    for repaired, written in progress.over(frames):
        if not written:
            continue
        _store(repaired, sink, meter)
        records.append(repaired.record)
        for name, value in repaired.seconds.items():
            run.seconds[name] = run.seconds.get(name, 0.0) + value
        observer.remark(FrameDone(repaired.record, repaired.error))
    if repairer.error is not None:
        observer.remark(Trouble(repairer.error))
    run.last = clock.perf_counter()
    if "chunk" not in run.settings:  # of a farm the other chunks may be fine, and want this one
        refuse_if_none_usable(source, records)
    summary = summarize(records)
    warnings = (*repairer.warnings, *sink.commit({"counts": summary}))
    if journal is not None:
        warnings = (*warnings, *journal.failures)
        journal.remove()
    warn(observer, warnings)
    run.lap("write")
    run.seconds["total"] = clock.perf_counter() - run.start
    return Report(
        command="repair",
        version=__version__,
        input=run.input,
        output=run.output,
        device=run.device,
        settings=_reported(run, rests),
        seconds=run.seconds,
        prims=prim_records(source, rest_counts),
        frames=tuple(records),
        warnings=(*source.warnings, *warnings),
        jitter=max(part.value for part in meter) if len(records) > 2 else None,
    )


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
) -> tuple[FrameRepairer, list[int | None]]:
    """Build the solver and the counter, once for all frames; count the rests' own intersections."""
    from dtrepair.intersect.scene_counts import SceneCounter
    from dtrepair.repair.repairer import SceneRepairer

    rest_counts: list[int | None] = []
    for mesh, rest in zip(source.meshes, rests, strict=True):
        counter = SceneCounter([rest.points], [mesh.faces], device=run.device)
        rest_counts.append(counter([rest.points]).total.triangles)
    options = in_units_of_frames(source, run.options)
    scene = SceneRepairer(bodies, options=options, device=run.device, ignore=run.ignored)
    mode = run.options.mode
    counter = make_counter(source, mode=mode, ignored=run.ignored, device=run.device)
    return (
        FrameRepairer(source, scene, counter, jobs=run.jobs, alone=run.alone, memory=memory),
        rest_counts,
    )


def _store(repaired: Repaired, sink: Sink, meters: list[JitterMeter]) -> None:
    for index, points in enumerate(repaired.points):
        sink.put(index, repaired.frame.time, points)
    pairs = zip(meters, repaired.frame.spaces, repaired.spaces, strict=False)
    for meter, before, after in pairs:
        meter.add(before, after)
