"""Frames counted again as blend shapes pose them, before these are written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dtrepair.pipeline.repair.corrections import TOLERANCE, CorrectionSink
from dtrepair.pipeline.repair.solve import FrameRepairer
from dtrepair.pipeline.stages.frames import Frame
from dtrepair.report.record import ContactRecord, FrameRecord
from dtrepair.wording import counted, listed

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount


@dataclass(frozen=True, kw_only=True)
class RecountOptions:
    """How near shapes come to the repaired points.

    Attributes:
        tolerances: parts of the diagonal, tried in turn until no surfaces touch that were apart:
            more shapes, less error.
        rounds: how often frames that rounding alone makes touch are repaired again.
    """

    tolerances: tuple[float, ...] = (TOLERANCE, 1e-5, 1e-6)
    rounds: int = 3


@dataclass(frozen=True)
class _Worse:
    """A frame that has more intersections as shapes pose it than as it was repaired."""

    record: FrameRecord
    frame: Frame
    count: SceneCount


def settle_shapes(
    sink: CorrectionSink,
    repairer: FrameRepairer,
    records: Sequence[FrameRecord],
    options: RecountOptions | None = None,
) -> tuple[list[FrameRecord], list[str]]:
    """Settle on the shapes of a sink; return the records that its output deserves, and warnings."""
    chosen = options or RecountOptions()
    by_time = {record.time: record for record in records if record.after is not None}
    worse: list[_Worse] = []
    for tolerance in chosen.tolerances:
        sink.settle(tolerance)
        worse = _worse(sink, repairer, by_time)
        if not worse:
            break
    for _ in range(chosen.rounds if worse else 0):
        _repair_again(sink, repairer, worse)
        sink.settle(chosen.tolerances[-1])
        worse = _worse(sink, repairer, by_time)
        if not worse:
            break
    changed = {own.record.time: _changed(own, repairer) for own in worse}
    return [changed.get(record.time, record) for record in records], _warnings(sink, worse)


def _worse(
    sink: CorrectionSink, repairer: FrameRepairer, records: Mapping[float | None, FrameRecord]
) -> list[_Worse]:
    """Return the frames that got worse by the rounding of shapes."""
    found = []
    for frame in sink.posed([np.nan if time is None else time for time in records]):
        record = records[None if np.isnan(frame.time) else frame.time]
        count = repairer.counter(frame.spaces, hidden=frame.hidden)
        assert record.after is not None
        if count.total.pairs > record.after.pairs:
            found.append(_Worse(record, frame, count))
    return found


def _repair_again(sink: CorrectionSink, repairer: FrameRepairer, worse: Sequence[_Worse]) -> None:
    """Repair frames as shapes pose them: what is left is as small as their rounding."""
    for own in worse:
        results = repairer.repairer(own.frame.poses)
        written = repairer.written(own.frame, [result.points for result in results])
        for index, points in enumerate(written):
            sink.put(index, own.frame.time, points)


def _changed(own: _Worse, repairer: FrameRepairer) -> FrameRecord:
    """Return the record of a frame with the counts of what is written."""
    record, count = own.record, own.count
    assert record.before is not None
    paths = [mesh.path for mesh in repairer.source.meshes]
    each = dict(zip(paths, count.each, strict=True))
    prims = tuple(replace(prim, after=each[prim.path]) for prim in record.prims)
    met = {(paths[i], paths[j]): pairs for (i, j), pairs in count.met.items()}
    known = {(old.first, old.second): old for old in record.contacts}
    contacts = [
        replace(known.get(key, ContactRecord(key[0], key[1], 0, 0)), after=met.get(key, 0))
        for key in sorted({*known, *(met if len(paths) > 1 else ())})
    ]
    better = count.total.pairs < record.before.pairs
    return replace(
        record,
        status="improved" if better else "unchanged",
        after=count.total,
        prims=prims,
        contacts=tuple(contacts),
        message=record.message or "the shapes of the output come near, and not near enough",
    )


def _warnings(sink: CorrectionSink, worse: Sequence[_Worse]) -> list[str]:
    """Return a warning about frames that shapes make intersect."""
    if not worse:
        return []
    times = [f"{own.frame.time:.10g}" for own in worse if not np.isnan(own.frame.time)]
    return [
        f"{sink.path}: with shapes instead of points {counted(len(worse), 'frame')} "
        f"({listed(times) or 'default'}) intersect again; --clearance leaves room for their "
        "rounding"
    ]
