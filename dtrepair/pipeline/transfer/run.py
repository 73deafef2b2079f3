"""A transfer from inputs to report: open, match, factor, move every frame, repair, write."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dtrepair import __version__
from dtrepair.cli.options.transfer import Inputs
from dtrepair.cli.terminal.console import Console
from dtrepair.cli.terminal.transfer_text import describe, draw_registration, print_report, say
from dtrepair.numerics.jitter_meter import JitterMeter
from dtrepair.pipeline.errors import CLEAN, FRAMES, REMAINING
from dtrepair.pipeline.repair.solve import FrameRepairer, Repaired, repair_frames
from dtrepair.pipeline.stages.bodies import in_units_of_frames
from dtrepair.pipeline.stages.frames import make_counter, prim_records, refuse_if_none_usable
from dtrepair.pipeline.stages.outputs import writing
from dtrepair.pipeline.stages.rest import Rest, choose_rests
from dtrepair.pipeline.stages.sinks import Sink
from dtrepair.pipeline.stages.sources import MeshSource, Source, StageSource, time_label
from dtrepair.pipeline.transfer.correspondence import Correspondence, find_correspondence
from dtrepair.pipeline.transfer.inputs import (
    Axes,
    PoseFiles,
    compare_axes,
    input_errors,
    input_problems,
    open_poses,
    open_target,
)
from dtrepair.pipeline.transfer.shapes import ShapeSink, open_shapes
from dtrepair.pipeline.transfer.sinks import open_clip
from dtrepair.pipeline.transfer.solve import FrameTransfer, PinSet, counted_frames, read_pin_set
from dtrepair.report.record import FrameRecord, Report, summarize
from dtrepair.wording import counted

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCounter
    from dtrepair.transfer import Transfer


@dataclass(frozen=True)
class Pair:
    """Both inputs with their rest poses and axes."""

    source: Source
    target: StageSource | MeshSource
    source_rest: Rest
    target_rest: Rest
    axes: Axes

    @property
    def meshes(self) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
        """Rest points and faces of source and target."""
        return (
            (self.source_rest.points, self.source.meshes[0].faces),
            (self.target_rest.points, self.target.meshes[0].faces),
        )


def run_transfer(run: Inputs, output: str, console: Console) -> tuple[int, Report | None]:
    """Do a whole transfer; return the exit code and the report (None for a dry run)."""
    pair = _open(run, console)
    open_sink = ShapeSink if run.options.shapes else open_clip
    sink = open_sink(pair.source, pair.target, output, run.settings())
    try:
        pins = read_pin_set(
            pair.target, pair.target_rest.points, run.options.pin, len(pair.source.times)
        )
        run.lap("read")
        if run.options.dry_run:
            _print_plan(console, pair, output)
            return CLEAN, None
        report = _transfer(run, pair, pins, sink, output, console)
    finally:
        sink.abort()
    print_report(console, report, repaired=run.options.repair is not None)
    return _exit_code(report.frames), report


def _open(run: Inputs, console: Console) -> Pair:
    options = run.options
    open_source = open_shapes if options.shapes else open_poses
    source = open_source(options.source_path, options.poses, run.selection)
    target = open_target(options.target_path, options.target_prim)
    run.warnings += [*source.warnings, *target.warnings, *input_problems(source, target)]
    rest = options.rest
    if rest is None and source.name != options.source_path:
        rest = options.source_path  # the poses are a stage of their own, the source its rest
    axes = compare_axes(source, target, (options.source_up, options.target_up))
    source_rest = choose_rests(source, rest, device=run.device)[0]
    target_rest = choose_rests(target, None, device=run.device)[0]
    for side, found in ((source, source_rest), (target, target_rest)):
        if found.origin.startswith("frame"):
            run.warnings.append(
                f"{side.name}: {side.meshes[0].path} has no points at the default time; its rest "
                f"pose is taken from {found.origin}"
            )
    console.warn(run.warnings)
    return Pair(source, target, source_rest, target_rest, axes)


def _match(run: Inputs, pair: Pair) -> Correspondence:
    """Pair the triangles; save and draw them as asked."""
    from dtrepair.transfer import write_correspondence

    options = run.options
    found = find_correspondence(*pair.meshes, markers=options.markers, file=options.correspondence)
    if options.save_correspondence is not None:
        with writing(options.save_correspondence):
            faces = [mesh[1] for mesh in pair.meshes]
            write_correspondence(options.save_correspondence, found.pairs, *faces)
    if options.picture is not None:
        try:
            with writing(options.picture):
                draw_registration(options.picture, *pair.meshes, found, up=pair.axes.up)
        except ImportError as error:
            run.late.append(f"{options.picture}: not drawn: {error}")
    return found


def _make_transfer(run: Inputs, pair: Pair, found: Correspondence) -> Transfer:
    from dtrepair.transfer import Transfer
    from dtrepair.transfer.rests import rotation_between_rests

    rotation = pair.axes.rotation
    if run.options.align == "rests":
        with input_errors(prefix="--align rests: "):
            rotation = rotation_between_rests(*pair.meshes, found.pairs)
    with input_errors():
        return Transfer(
            *pair.meshes[0],
            *pair.meshes[1],
            found.pairs,
            rotation=rotation,
            up=pair.axes.up,
            scale=run.options.root_scale,
            snap=run.options.ground,
        )


def _transfer(
    run: Inputs, pair: Pair, pins: PinSet | None, sink: Sink, output: str, console: Console
) -> Report:
    found = _match(run, pair)
    run.lap("match")
    moves = FrameTransfer(_make_transfer(run, pair, found), pair.source, pair.axes, pins)
    run.lap("factor")
    records, jitter, rest_count = _move_frames(run, pair, moves, sink, console)
    refuse_if_none_usable(pair.source, records)
    section, late = describe(found, moves, pair.meshes, pair.target.meshes[0].path)
    late = [*run.late, *found.warnings, *late]
    if rest_count:
        late.append(
            f"{pair.target.name}: the rest pose has {rest_count} intersecting triangles of its own"
        )
    run.lap("examine")
    late += sink.commit({"counts": summarize(records), "transfer": section})
    run.lap("write")
    console.warn(late)
    run.seconds |= {**moves.seconds, "read": run.seconds["read"] + moves.seconds["read"]}
    run.seconds["total"] = clock.perf_counter() - run.start
    return Report(
        command="transfer",
        version=__version__,
        input=run.options.source_path,
        output=output,
        device=run.device,
        settings=run.settings(),
        seconds=run.seconds,
        prims=prim_records(pair.target, [rest_count]),
        frames=tuple(records),
        warnings=(*run.warnings, *late),
        jitter=jitter,
        transfer=section,
    )


def _move_frames(
    run: Inputs, pair: Pair, moves: FrameTransfer, sink: Sink, console: Console
) -> tuple[list[FrameRecord], float | None, int]:
    """Transfer, repair and write all frames; return records, jitter, and the rest's count."""
    counter = make_counter(pair.target, mode="both", device=run.device)
    rest_count = counter([pair.target_rest.points]).total.triangles
    records, meter = [], JitterMeter()
    outcomes = _outcomes(run, pair, moves, counter, console)
    for done in console.progress(outcomes, total=len(pair.source.times), what="transferring"):
        records.append(done.record)
        say(console, done)
        if done.frame.usable:
            points = done.frame.points[0] if done.points[0] is None else done.points[0]
            sink.put(0, done.frame.time, points)
            meter.add(done.frame.spaces[0], done.spaces[0])
        for name, value in done.seconds.items():
            run.seconds[name] = run.seconds.get(name, 0.0) + value
    run.last = clock.perf_counter()
    measured = run.options.repair is not None and len(records) > 2
    return records, meter.value if measured else None, rest_count


def _outcomes(
    run: Inputs, pair: Pair, moves: FrameTransfer, counter: SceneCounter, console: Console
) -> Iterator[Repaired]:
    """Frames transferred, and repaired where asked; all of them counted."""
    options = run.options.repair
    if options is None:
        yield from counted_frames(moves.frames(), pair.target, counter)
        return
    from dtrepair.repair.repairer import SceneRepairer
    from dtrepair.repair.scene.bodies import Body

    rest, faces = pair.meshes[1]
    pin = None if moves.pins is None else moves.pins.mask(len(rest))
    options = in_units_of_frames(pair.target, options)
    scene = SceneRepairer([Body(rest, faces, pin=pin)], options=options, device=run.device)
    repairer = FrameRepairer(pair.target, scene, counter, jobs=run.jobs, alone=_alone(run, pair))
    yield from repair_frames(moves.frames(), repairer)
    run.late += repairer.warnings
    console.trace(repairer.error)


def _alone(run: Inputs, pair: Pair) -> bool:
    """Whether frames are repaired each for itself: poses in files need not be a motion."""
    chosen = run.options.alone
    return isinstance(pair.source, PoseFiles) if chosen is None else chosen


def _print_plan(console: Console, pair: Pair, output: str) -> None:
    """Print what a run would do."""
    rows = [
        [f"{side.name} {side.meshes[0].path}", str(len(mesh[0])), str(len(mesh[1])), rest.origin]
        for side, mesh, rest in zip(
            (pair.source, pair.target),
            pair.meshes,
            (pair.source_rest, pair.target_rest),
            strict=True,
        )
    ]
    console.table(["mesh", "vertices", "triangles", "rest pose"], rows)
    labels = [time_label(float(time)) for time in pair.source.times]
    frames = labels[0] if len(labels) == 1 else f"{labels[0]} to {labels[-1]}"
    console.result(f"{counted(len(labels), 'frame')} ({frames}) would be written to {output}")


def _exit_code(records: tuple[FrameRecord, ...]) -> int:
    if any(record.status == "failed" for record in records):
        return FRAMES
    left = any(record.after is not None and record.after.pairs for record in records)
    return REMAINING if left else CLEAN
