"""Keys of a stage: read as tracks, repaired, counted, written."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from dtrepair.keyposes.tracks import Pose, Track
from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.repair.records import in_stage_units
from dtrepair.pipeline.repair.solve import FrameRepairer, Repaired
from dtrepair.pipeline.stages.frames import Frame, count_frame, placed_frame, read_frame, unusable
from dtrepair.pipeline.stages.sinks import Sink
from dtrepair.pipeline.stages.sources import StageSource
from dtrepair.report.record import FrameRecord

if TYPE_CHECKING:
    from dtrepair.diagnosis import Diagnosis, Strain
    from dtrepair.intersect.scene_counts import SceneCount


def _inside(times: Iterable[float], spans: Sequence[tuple[float, float]]) -> list[float]:
    """Return which times lie inside one of some spans, sorted and apart."""
    starts = [start for start, _ in spans]
    places = ((time, bisect_left(starts, time) - 1) for time in times)
    return [time for time, place in places if place >= 0 and time < spans[place][1]]


@dataclass(frozen=True, kw_only=True)
class KeyRepairOptions:
    """How keys are repaired.

    Args:
        room: Clearance of given keys between which poses are looked at, diagonals of the rest
            poses, where none is asked for: tightened keys touch, and leave those no room.
    """

    room: float = 0.001


class StageKeys:
    """The keys of an input; answers what `dtrepair.keyposes.search` asks about poses.

    tracks: of each mesh; selected: times of keys to repair; between: times of frames that are no
    keys, and held those of them that lie in none of the spans; spans: times of neighbouring keys
    that are selected and have points, as the frames between them; skipped: spans that lack points;
    lacking: why frames between keys, by their times, do; counts: of the selected keys as they came,
    None of unusable ones.
    """

    def __init__(
        self,
        source: StageSource,
        repairer: FrameRepairer,
        rigid: Sequence[bool],
        check: Callable[[], None],
        *,
        options: KeyRepairOptions = KeyRepairOptions(),
    ) -> None:
        """Read all keys, and count those selected; one that collapsed cannot be used.

        repairer: solves and verifies frame by frame; rigid: of each mesh; check: called from time
        to time, and ends the work by what it raises.
        """
        self.source, self.repairer, self.rigid, self.check = source, repairer, rigid, check
        times = [float(time) for time in source.all_times]
        self.selected = [time for time in times if time in source.times]
        self.frames = {time: read_frame(source, time) for time in times}
        self.counts: dict[float, SceneCount | None] = {}
        for time in self.selected:
            check()
            self.frames[time], self.counts[time] = count_frame(repairer.counter, self.frames[time])
        self._usable = [time for time in times if self.frames[time].usable]
        # Of in-betweens: what is interpolated has no shape that it should keep, so they are judged
        # where they are repaired, and keys as they end.
        self._strains: dict[float, list[tuple[tuple[Pose, ...], tuple[Strain, ...]]]] = {}
        chosen = [pair for pair in pairwise(times) if set(pair) <= set(self.selected)]
        others = [float(time) for time in source.clock.keys if time not in self.frames]
        lacking: dict[float, str] = {}
        for time in _inside(others, chosen):
            check()
            if not (frame := read_frame(source, time)).usable:
                lacking[time] = unusable(frame).message
        self.spans = [
            span
            for span in chosen
            if set(span) <= set(self._usable) and not _inside(lacking, [span])
        ]
        self.skipped, self.lacking = len(chosen) - len(self.spans), lacking
        self.between = tuple(time for time in others if time not in lacking)
        self.held = frozenset(self.between).difference(_inside(self.between, self.spans))
        self.tracks = self.given
        own = repairer.repairer
        room = options.room * own.scene.scale.diagonal(own.scene.rest)
        # The nearest first.
        ways = dict.fromkeys((own.with_room(room), own.untightened()))
        self._repairers = [repairer.by(way) for way in ways]

    @property
    def given(self) -> tuple[Track, ...]:
        """The tracks of the input."""
        return tuple(self._track(index) for index in range(len(self.source.meshes)))

    def _track(self, index: int) -> Track:
        mesh = self.source.meshes[index]
        own = np.asarray(mesh.handle.times)
        # Where frames are written between the keys, each mesh needs all keys: it is held there.
        keys = tuple(time for time in self._usable if self.between or time in own)
        at = keys or tuple(self._usable[:1])
        if not at:
            return Track((), (mesh.rest.astype(np.float32),))
        poses = tuple(self.frames[time].points[index] for time in at)
        # A skin bends between its keys; points are interpolated as soon as they are written.
        bends = bool(keys) and (mesh.handle.skinned or bool(self.between))
        original = self._reader(index) if bends else None
        return Track(keys, poses, original=original, frames=self.between, held=self.held)

    def _reader(self, index: int) -> Any:
        def read(time: float) -> Pose:
            points = self.source.read(self.source.meshes[index], time)
            assert points is not None
            return points

        return read

    def frame(self, time: float, poses: Sequence[Pose]) -> Frame:
        """Return poses (V, 3) of all meshes as a frame."""
        frame = placed_frame(self.source, time, poses)
        if not frame.usable:
            raise InputError(f"{self.source.name}: {frame.failure}")
        return frame

    def count(self, time: float, poses: Sequence[Pose]) -> SceneCount:
        """Return counts of poses at a time."""
        return self._counted(self.frame(time, poses))

    def _counted(self, frame: Frame) -> SceneCount:
        return self.repairer.counter(frame.spaces, hidden=frame.hidden)

    def pairs(self, time: float, poses: Sequence[Pose]) -> int:
        """Return intersecting pairs of poses at a time."""
        return self.count(time, poses).total.pairs

    @property
    def ways(self) -> Sequence[int]:
        """The ways to repair a pose, the nearest first."""
        return range(len(self._repairers))

    def repair(self, time: float, poses: Sequence[Pose], way: int) -> tuple[Pose, ...] | None:
        """Return poses with fewer pairs; None where there are none."""
        frame = self.frame(time, poses)
        repaired = _repaired(self._repairers[way], frame)
        if all(points is None for points in repaired.points):
            return None
        filled, left = _filled(frame, repaired), repaired.record.left
        if not left.left_out:
            self._strains.setdefault(time, []).append((filled, left.strains))
        return filled

    def allowed(self, index: int, time: float, given: Pose, pose: Pose) -> Pose:
        """Return the nearest pose that mesh `index` may have at a time: a rigid one only moves."""
        if not self.rigid[index] or np.array_equal(given, pose):
            return pose
        from dtrepair.repair.surface.rigid_bodies import RigidBodies

        mesh, several = self.source.meshes[index], len(self.source.meshes) > 1
        old, new = (np.asarray(points, np.float64) for points in (given, pose))
        if several:
            old, new = (self.source.to_world(mesh, time, points) for points in (old, new))
        fitted = RigidBodies([(0, len(old))], np.ones(len(old))).fitted(old, new)
        if several:
            fitted = self.source.to_local(mesh, time, fitted)
        return fitted.astype(np.float32)

    def check_key(self, time: float) -> Repaired:
        """Count a key of the input."""
        from dtrepair.diagnosis import Status
        from dtrepair.repair.result import Count, RepairResult

        frame = self.frames[time]
        if not frame.usable:
            return self.repairer.finish(frame, None)
        none = Count(0, 0)  # `finish` believes its own counts only
        unmoved = [RepairResult(points, none, none, 0, Status.CLEAN) for points in frame.spaces]
        return self.repairer.finish(frame, unmoved, self.counts[time])

    def repair_key(self, time: float) -> Repaired:
        """Repair a key of the input into `tracks`."""
        frame = self.frames[time]
        if not frame.usable:
            return self.repairer.finish(frame, None)
        repaired = self._given_repaired(frame, self.counts[time])
        tracks = list(self.tracks)
        for index, points in enumerate(repaired.points):
            if points is not None:
                tracks[index] = tracks[index].with_key(time, points, all_times=self._usable)
        self.tracks = tuple(tracks)
        return repaired

    def _given_repaired(self, frame: Frame, before: SceneCount | None) -> Repaired:
        """Return a key near to the input, with room; farther from it only where that leaves less.

        One between which and another nothing is looked at is repaired as any pose.
        """
        if not any(frame.time in span for span in self.spans):
            return _repaired(self.repairer, frame, before)
        found = _repaired(self._repairers[0], frame, before)
        for way in self._repairers[1:]:
            if any(_wrong(found)):
                found = min(found, _repaired(way, frame, before), key=_wrong)
        return found

    def _strained(self, time: float, poses: Sequence[Pose]) -> tuple[Strain, ...]:
        """Return what was strained where an added key was repaired, by what it is nearest to."""

        def away(way: tuple[tuple[Pose, ...], tuple[Strain, ...]]) -> float:
            return max(float(np.abs(a - b).max()) for a, b in zip(way[0], poses, strict=True))

        return min(self._strains.get(time, []), key=away, default=((), ()))[1]

    def write(self, tracks: Sequence[Track], sink: Sink) -> None:
        """Put what changed: keys, and frames between them; others keep the samples of the input."""
        for index, track in enumerate(tracks):
            # A mesh at the default time only has no times: its one pose is its key.
            for time in track.written if track.changed else ():
                sink.put(index, time, track.at(time) if track.moved_at(time) else None)

    def record(
        self, record: FrameRecord | None, time: float, tracks: Sequence[Track]
    ) -> FrameRecord:
        """Return the record of a key as it is in the end; `record` is that of its repair alone."""
        from dtrepair.numerics.metrics import displacements

        changed = [time in track.changed for track in tracks]
        if record is not None and (record.before is None or not any(changed)):
            return record
        old = [track.at(time) for track in self.given]
        new = [track.at(time) for track in tracks]
        frame, ended = (self.frame(time, poses) for poses in (old, new))
        spaces = [[np.asarray(p, np.float64) for p in own.spaces] for own in (frame, ended)]
        before, after = (self._counted(own) for own in (frame, ended))
        moved = [displacements(a, b) for a, b in zip(*spaces, strict=True)]
        strains = self._strained(time, new)
        if record is not None:
            # A key that looser bounds held is not strained for it.
            strains = self.repairer.repairer.strains(frame.spaces, ended.spaces, loosely=True)
        sizes = self.repairer.record.sizes(frame, spaces[0])
        left = in_stage_units(_with_strains(record, strains, after.total.pairs), sizes)
        parts = self.repairer.modelled.in_frame(time, before, frame.spaces, after, ended.spaces)
        status = "clean" if not after.total.pairs else "improved"
        if left.strains:
            status = "strained"
        elif after.total.pairs >= max(before.total.pairs, 1):
            status = "unchanged"
        return replace(
            record or FrameRecord(time=time, status=status, message="added key"),
            status=status,
            left=left,
            before=before.total,
            after=after.total,
            displacement_max=max(float(part.max()) for part in moved),
            displacement_mean=float(np.concatenate(moved).mean()),
            prims=self.repairer.record.prims(sizes, spaces[0], spaces[1], before, after),
            modelled=parts.modelled,
            faults=parts.faults,
        )


def _repaired(repairer: FrameRepairer, frame: Frame, before: SceneCount | None = None) -> Repaired:
    try:
        solution: Any = repairer.repairer(frame.poses)
    except Exception as error:
        solution = error
    return repairer.finish(frame, solution, before)


def _wrong(repaired: Repaired) -> tuple[float, bool]:
    """Return how many pairs a key has left, infinite if it failed, and whether it is not clean."""
    after = repaired.record.after
    return np.inf if after is None else after.pairs, repaired.record.status != "clean"


def _with_strains(record: FrameRecord | None, strains: Sequence[Strain], pairs: int) -> Diagnosis:
    """Return what is left of a key: strains as it ends; what was left out, where pairs are left."""
    from dtrepair.diagnosis import Diagnosis

    left = record.left if record is not None else Diagnosis()
    if strains or not (left.left_out and pairs):
        left = replace(left, strains=tuple(strains))
    return left


def _filled(frame: Frame, repaired: Repaired) -> tuple[Pose, ...]:
    """Return the repaired points of every mesh, those of the frame where nothing changed."""
    return tuple(
        old if new is None else new for old, new in zip(frame.points, repaired.points, strict=True)
    )
