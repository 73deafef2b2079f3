"""The frames of a transfer: moved, repaired where that was chosen, counted, and written."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field, replace

from dtrepair.numerics.metrics import JitterMeter
from dtrepair.pipeline.clock import Clock
from dtrepair.pipeline.modelled.parts import tell_modelled
from dtrepair.pipeline.modelled.references import modelled_parts
from dtrepair.pipeline.observer import FrameDone, Observer, Progress, Trouble, warn
from dtrepair.pipeline.repair.run import Run, make_repairer, refuse_wide_clearance
from dtrepair.pipeline.repair.solve import Repaired, repair_frames
from dtrepair.pipeline.stages.bodies import make_bodies, read_controls
from dtrepair.pipeline.stages.frames import make_counter
from dtrepair.pipeline.stages.rest import thin_warnings
from dtrepair.pipeline.stages.sinks import Sink
from dtrepair.pipeline.transfer.inputs import PoseFiles
from dtrepair.pipeline.transfer.pair import Pair
from dtrepair.pipeline.transfer.settings import TransferSettings
from dtrepair.pipeline.transfer.solve import FrameTransfer, PinSet, counted_frames
from dtrepair.report.parts import AttachedList
from dtrepair.report.record import FrameRecord


@dataclass
class TransferRun:
    """A transfer with its inputs and its output open."""

    source: str
    output: str
    settings: TransferSettings
    recorded: dict[str, object]
    device: str
    jobs: int | None
    observer: Observer
    pair: Pair
    pins: PinSet | None
    sink: Sink
    clock: Clock
    late: list[str] = field(default_factory=list)  # warnings that come while it runs
    attached: AttachedList = field(default_factory=AttachedList)
    alone_from: float | None = None  # the first frame that could not be repaired together


def move_frames(
    run: TransferRun, moves: FrameTransfer
) -> tuple[list[FrameRecord], float | None, list[int | None]]:
    """Transfer, repair and write all frames; return records, jitter, and the rests' counts."""
    target = run.pair.target
    rest_counts: list[int | None] = []
    records, meters = [], [JitterMeter() for _ in target.meshes]
    with (
        Progress(run.observer, "transferring", len(run.pair.source.times)) as progress,
        closing(_outcomes(run, moves, rest_counts, progress)) as outcomes,
    ):
        for done in progress.over(outcomes):
            records.append(done.record)
            run.observer.remark(FrameDone(done.record, done.error))
            if done.frame.usable:
                _store(run, done)
                for meter, before, after in zip(
                    meters, done.frame.spaces, done.spaces, strict=True
                ):
                    meter.add(before, after)
            run.clock.add(done.seconds)
    run.clock.skip()
    measured = run.settings.repair is not None and len(records) > 2
    jitter = max(meter.value for meter in meters) if measured else None
    return records, jitter, rest_counts


def _store(run: TransferRun, done: Repaired) -> None:
    """Write what moved; meshes that never do are as they were."""
    for index in run.pair.to_meshes.moving:
        points = done.points[index]
        kept = done.frame.points[index] if points is None else points
        run.sink.put(index, done.frame.time, kept)


def _outcomes(
    run: TransferRun, moves: FrameTransfer, rest_counts: list[int | None], progress: Progress
) -> Generator[Repaired]:
    """Yield frames transferred, and repaired where that was chosen; all of them counted.

    The intersections of the target's rest poses themselves are put into `rest_counts`.
    """
    joined = run.pair.to_meshes
    if run.settings.repair is None:
        # Of several meshes, what lies in each other at rest was modelled so.
        rests = list(joined.rests)
        modelled = modelled_parts(joined.source, rests=rests) if joined.several else None
        counter = make_counter(
            joined.source,
            mode="both",
            device=run.device,
            attachments=None if modelled is None else modelled.attachments,
        )
        time = float(joined.source.all_times[0])
        count = counter(joined.placed(time, [rest.points for rest in rests]))
        rest_counts += [own.triangles for own in count.each]
        yield from counted_frames(moves.frames(), joined, counter)
        return
    yield from _repaired(run, moves, rest_counts, progress)


def _repaired(
    run: TransferRun, moves: FrameTransfer, rest_counts: list[int | None], progress: Progress
) -> Generator[Repaired]:
    """Yield frames repaired as one scene, as `repair` would: bodies, attachments, layers."""
    joined, settings = run.pair.to_meshes, run.settings
    target, options = joined.source, settings.repair
    assert options is not None
    controls = read_controls(target, settings.objects, settings.tables, sets=False)
    rests = list(joined.rests)
    warn(run.observer, controls.warnings)
    placed = make_bodies(target, rests, controls, mode=options.mode)
    refuse_wide_clearance(target, options, placed.bodies)
    warn(run.observer, thin_warnings(target, rests, controls.settings, options.clearance))
    pins = None if moves.pins is None else joined.split(moves.pins.mask(len(joined.points)))
    bodies = [
        body if pins is None or pins[index] is None else replace(body, pin=pins[index])
        for index, body in enumerate(placed.bodies)
    ]
    repair = Run(
        run.source,
        run.output,
        run.device,
        options,
        run.jobs,
        _alone(run),
        controls.ignored,
        controls.told,
        {},
        run.clock,
    )
    repairer, counts = make_repairer(repair, target, rests, bodies, told_by_rest=True)
    rest_counts += counts
    tell_modelled(run.observer, repairer.modelled, asked=controls.told.attached, unclear=placed.met)
    run.attached = repairer.modelled.attached
    repairer.progress = progress.ahead
    yield from repair_frames(moves.frames(), repairer)
    run.late += repairer.warnings
    run.alone_from = repairer.alone_from
    if repairer.error is not None:
        run.observer.remark(Trouble(repairer.error))


def _alone(run: TransferRun) -> bool:
    """Return whether frames are repaired each for itself: poses in files need not be a motion."""
    chosen = run.settings.alone
    single = isinstance(run.pair.source, PoseFiles) or run.settings.options.shapes
    published = run.settings.repair is not None and run.settings.repair.method == "paper"
    return published or (single if chosen is None else chosen)
