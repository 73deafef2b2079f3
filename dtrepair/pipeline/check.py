"""A check: the intersecting triangles of each frame of a stage or mesh file."""

from __future__ import annotations

import os
import time as clock
from collections.abc import Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Unpack

from dtrepair import __version__
from dtrepair.pipeline.check_settings import CheckChoices, CheckSettings
from dtrepair.pipeline.clock import Clock
from dtrepair.pipeline.errors import plain_errors
from dtrepair.pipeline.modelled.parts import ModelledParts, tell_modelled
from dtrepair.pipeline.modelled.references import (
    frames_tell,
    modelled_parts,
    untold_in_check,
)
from dtrepair.pipeline.modelled.unrepaired import repaired_otherwise
from dtrepair.pipeline.observer import (
    SILENT,
    Observer,
    PairsFound,
    Progress,
    RecordingObserver,
    warn,
)
from dtrepair.pipeline.repair.records import contact_records
from dtrepair.pipeline.selection import CALLED, ObjectSettings, asking
from dtrepair.pipeline.stages.devices import use_device
from dtrepair.pipeline.stages.enclosed_parts import EnclosedParts
from dtrepair.pipeline.stages.frames import (
    Frame,
    HiddenMeshes,
    count_frame,
    frame_time,
    make_counter,
    mode_warnings,
    prim_records,
    read_frames,
    refuse_if_none_usable,
    side_by_side,
    unusable,
)
from dtrepair.pipeline.stages.matching import (
    CalledPairs,
    MeshPairs,
    called_pairs,
    ignored_pairs,
    meshes_matched,
)
from dtrepair.pipeline.stages.object_settings import read_settings, recorded
from dtrepair.pipeline.stages.outputs import FilePath
from dtrepair.pipeline.stages.shot.sets import find_sets, pairs_of_sets
from dtrepair.pipeline.stages.sources import Source, open_source
from dtrepair.pipeline.stages.world_mesh import WorldScene
from dtrepair.report.parts import LISTED, LISTED_ATTACHED, WornRecord
from dtrepair.report.record import FramePrimRecord, FrameRecord, Report

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCounter
    from dtrepair.numerics.geometry import IntArray


def check_stage(
    stage: FilePath,
    settings: CheckSettings | None = None,
    *,
    jobs: int | None = None,
    device: str = "auto",
    observer: Observer = SILENT,
    **choices: Unpack[CheckChoices],
) -> Report:
    """Count the intersecting triangles of a stage or mesh file, exactly, per mesh and frame.

    Args:
        stage: path of a USD stage or mesh file.
        settings: all choices of a run as one object, such as `CheckSettings.from_report`.
        jobs: threads for frames side by side; None: one for each processor.
        device: "auto", "cpu" or "cuda[:N]".
        observer: hears of the run, and may cancel it.
        choices: fields of `CheckSettings`, by name; they replace those of `settings`.

    Raises:
        PipelineError: with the exit code that stands for it, see its subclasses.
    """
    chosen = replace(settings or CheckSettings(), **choices)
    recording = RecordingObserver(observer)
    with plain_errors():
        report = _check(os.fspath(stage), chosen, jobs, use_device(device), recording)
    return replace(report, warnings=recording.warnings)


def checked_scene(
    source: Source, settings: CheckSettings | None = None, *, observer: Observer = SILENT
) -> WorldScene:
    """Return the meshes of an input as one, counted as a check counts them: for pictures.

    observer: hears what is taken as modelled.
    """
    chosen = settings or CheckSettings()
    ignored = _ignored(source, chosen)
    _, _, modelled = _modelled(source, chosen, ignored, observer)
    return WorldScene(source, mode=chosen.mode, ignored=ignored, attachments=modelled.attachments)


def _check(
    stage: str, settings: CheckSettings, jobs: int | None, device: str, observer: Observer
) -> Report:
    watch = Clock()
    source = open_source(stage, settings.selection)
    warn(observer, [*source.warnings, *mode_warnings(source, settings.mode)])
    watch.lap("read")
    ignored = _ignored(source, settings)
    each, told, modelled = _modelled(source, settings, ignored, observer)
    counter = make_counter(
        source,
        mode=settings.mode,
        ignored=ignored,
        device=device,
        attachments=modelled.attachments,
    )
    enclosed = EnclosedParts(source, mode=settings.mode, ignored=ignored)
    hidden = HiddenMeshes(source)
    frames = hidden.among(read_frames(source, source.times))
    records: list[FrameRecord] = []
    met: list[IntArray] = []
    known = settings.counting != "auto" or frames_tell(source)
    # So that each pair of parts that is listed as attached is found in the frames.
    most = LISTED_ATTACHED if settings.find_worn else LISTED
    with (
        Progress(observer, "checking", len(source.times)) as progress,
        closing(_counted(source, frames, counter, enclosed, modelled, jobs, most)) as counted,
    ):
        for record, pairs in progress.over(counted):
            records.append(record)
            if pairs is not None:
                observer.remark(pairs)
                met += [] if known else [pairs.pairs]
    warn(observer, [*untold_in_check(source, met, told=told), *hidden.warnings])
    refuse_if_none_usable(source, records)
    worn = _worn(source, settings, ignored, told, device) if settings.find_worn else ()
    watch.lap("detect")
    return Report(
        command="check",
        version=__version__,
        input=stage,
        device=device,
        settings=_recorded(source, settings, each),
        seconds=watch.total(),
        prims=prim_records(source),
        frames=tuple(records),
        attached=modelled.attached,
        passing=modelled.passing,
        worn=worn,
    )


def _ignored(source: Source, settings: CheckSettings) -> MeshPairs:
    """Pairs of meshes (i, j), i <= j, whose contacts do not count: as in a repair.

    But the contacts of a mesh of the set with itself do, if they were not modelled: it may be no
    set after all.
    """
    ignored = set(ignored_pairs(source, settings.ignore))
    if settings.counting == "auto":
        tables = [table for table in settings.tables if table.settings.mobility is not None]
        # A repair has more meshes: what a table says of others is not asked here.
        tables = [table for table in tables if meshes_matched(source, table.path, table.origin)]
        find_sets(source, read_settings(source, tables=tables, keys=("mobility",)).each)
        ignored |= {(i, j) for i, j in pairs_of_sets(source) if i < j}
    return tuple(sorted(ignored))


def _modelled(
    source: Source,
    settings: CheckSettings,
    ignored: MeshPairs,
    observer: Observer,
) -> tuple[list[ObjectSettings], CalledPairs, ModelledParts]:
    """The settings of each mesh, what is called attached, what counts as modelled; it is told."""
    found = read_settings(source, tables=asking(settings.tables, CALLED), keys=CALLED)
    asked = {"attach": settings.attach, "detach": settings.detach}
    told, warnings = called_pairs(source, found.each, **asked)
    known = {**asked, "ignore": settings.ignore}
    warn(observer, [*found.warnings, *warnings])
    if missing := repaired_otherwise(source, settings.counting, known):
        observer.warning(
            f"repaired with {missing}, and counted without: give it here as well to count as the "
            "repair did"
        )
    auto = settings.counting == "auto"
    modelled = modelled_parts(source, ignored=ignored, told=told, auto=auto)
    tell_modelled(observer, modelled, asked=told.attached)
    return found.each, told, modelled


def _worn(
    source: Source, settings: CheckSettings, ignored: MeshPairs, told: CalledPairs, device: str
) -> tuple[WornRecord, ...]:
    """What a repair that counts like the check would take as worn."""
    from dtrepair.pipeline.modelled.worn import worn_without_repair
    from dtrepair.repair.options import RepairOptions

    options = RepairOptions(mode=settings.mode, rest_contacts=settings.counting)
    return worn_without_repair(
        source,
        options,
        tables=settings.tables,
        ignored=ignored,
        told=told,
        device=device,
    )


def _recorded(
    source: Source, settings: CheckSettings, each: Sequence[ObjectSettings]
) -> dict[str, Any]:
    """The choices of a check for its report."""
    return {
        "mode": settings.mode,
        "ignore": list(settings.ignore),
        "attach": list(settings.attach),
        "detach": list(settings.detach),
        "objects": recorded(source, each),
        "rest_contacts": settings.counting,
        **({"find_worn": True} if settings.find_worn else {}),
        **settings.selection.recorded,
    }


def _counted(
    source: Source,
    frames: Iterable[Frame],
    counter: SceneCounter,
    enclosed: EnclosedParts,
    modelled: ModelledParts,
    jobs: int | None,
    most: int,
) -> Generator[tuple[FrameRecord, PairsFound | None]]:
    """Yield the record of each frame, and its pairs that count; None where it is unusable.

    most: so many pairs of parts that are modelled are listed.
    """

    def count(frame: Frame) -> tuple[FrameRecord, PairsFound | None]:
        start = clock.perf_counter()
        frame, found = count_frame(counter, frame)
        if found is None:
            return unusable(frame), None
        each = zip(source.meshes, found.each, strict=True)
        parts = modelled.in_frame(frame.time, found, frame.spaces, found, frame.spaces, most=most)
        record = FrameRecord(
            time=frame_time(frame),
            status="unchanged" if found.total.pairs else "clean",
            before=found.total,
            after=found.total,
            seconds=clock.perf_counter() - start,
            prims=tuple(FramePrimRecord(path=m.path, before=c, after=c) for m, c in each),
            contacts=contact_records(source, found, found),
            enclosed=enclosed(frame, found),
            modelled=parts.modelled,
            faults=parts.faults,
        )
        return record, PairsFound(record.time, found.pairs)

    for _, found in side_by_side(count, frames, jobs=jobs):
        yield found
