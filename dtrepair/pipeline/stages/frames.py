"""Frames of an input one by one, and work on several of them side by side."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.stages.sources import Source, SourceMesh, StageSource, placing_time
from dtrepair.report.record import FrameRecord, PrimRecord
from dtrepair.wording import frames_named, listed

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount, SceneCounter
    from dtrepair.numerics.attachments import Attachments

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Frame:
    """One frame: local points (V, 3) float32 of each mesh, or why there are none.

    `failure` is an unusable frame, `blocked` the path of a mesh without points at that time.
    `spaces`: the points in the space of counting and repair: local for one mesh, else world.
    `hidden`: which of several meshes cannot be seen; `spaces` says where they would be, or of
    those that are `unplaced` only their shape.
    """

    time: float
    points: tuple[NDArray[np.float32], ...] = ()
    spaces: tuple[NDArray[Any], ...] = ()
    failure: str | None = None
    blocked: str | None = None
    hidden: frozenset[int] = frozenset()
    unplaced: frozenset[int] = frozenset()

    @property
    def poses(self) -> list[Any]:
        """The `spaces` for a solver: hidden meshes are not there."""
        from dtrepair.repair.scene.bodies import Absent

        return [
            Absent(own, index not in self.unplaced) if index in self.hidden else own
            for index, own in enumerate(self.spaces)
        ]

    @property
    def usable(self) -> bool:
        """Whether the frame has points."""
        return self.failure is None and self.blocked is None


def read_frames(source: Source, times: Iterable[float]) -> Iterator[Frame]:
    """Read frames in order. One mesh stays in local space; several meet in world space."""
    for time in times:
        yield read_frame(source, float(time))


def read_frame(source: Source, time: float) -> Frame:
    """Read one frame; an unusable one becomes a `Frame` that says why."""
    from usd_io import FrameError

    points: list[NDArray[np.float32]] = []
    for mesh in source.meshes:
        try:
            local = source.read(mesh, time)
        except FrameError as error:
            return Frame(time, failure=str(error))
        if local is None:
            return Frame(time, blocked=mesh.path)
        points.append(local)
    return placed_frame(source, time, points)


def placed_frame(source: Source, time: float, points: Sequence[NDArray[np.float32]]) -> Frame:
    """Return local points (V, 3) of each mesh at a time as a frame; one that fails says why."""
    from usd_io import FrameError

    if len(source.meshes) == 1:
        return Frame(time, tuple(points), tuple(points))
    hidden, unplaced, spaces = set[int](), set[int](), list[NDArray[Any]]()
    for index, (mesh, local) in enumerate(zip(source.meshes, points, strict=True)):
        try:
            space = source.to_world(mesh, time, local)
            if len(mesh.faces) > 1 and np.ptp(space.astype(np.float32), axis=0).max() == 0.0:
                unplaced.add(index)
                space = mesh.rest
            elif _hidden(source, mesh, time):
                hidden.add(index)
            spaces.append(space)
        except FrameError as error:
            return Frame(time, failure=str(error))
    gone = frozenset(hidden | unplaced), frozenset(unplaced)
    return Frame(time, tuple(points), tuple(spaces), hidden=gone[0], unplaced=gone[1])


def _hidden(source: Source, mesh: SourceMesh, time: float) -> bool:
    """Return whether a mesh is invisible at a time, or scaled to nothing."""
    return isinstance(source, StageSource) and source.matrices.hidden(mesh.handle, time)


class HiddenMeshes:
    """The frames in which meshes are hidden, by their visibility, a scale or points at one place.

    There nothing of them is counted or changed.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._times: dict[int, list[float]] = {}

    def among(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Pass frames on, and remember the meshes."""
        for frame in frames:
            for index in sorted(frame.hidden):
                self._times.setdefault(index, []).append(frame.time)
            yield frame

    @property
    def warnings(self) -> tuple[str, ...]:
        """What there is to tell of them, once they have passed."""
        found = [
            f"{self._source.meshes[index].path}{_in_frames(times)}"
            for index, times in self._times.items()
        ]
        if not found:
            return ()
        return (
            "hidden by visibility, by a scale or by points at one place, so that nothing of them "
            f"counts or changes there: {listed(found)}",
        )


def _in_frames(times: Sequence[float]) -> str:
    """Return frames in a sentence; the default time needs no word."""
    numbered = [time for time in times if not math.isnan(time)]
    return f" in {frames_named(numbered)}" if numbered else ""


def frame_time(frame: Frame) -> float | None:
    """Time code for a report: None for the default time and for mesh files."""
    return None if math.isnan(frame.time) else frame.time


def unusable(frame: Frame) -> FrameRecord:
    """Record of a frame without points."""
    if frame.failure is not None:
        return FrameRecord(time=frame_time(frame), status="failed", message=frame.failure)
    message = f"{frame.blocked}: the sample is blocked"
    return FrameRecord(time=frame_time(frame), status="skipped", message=message)


def refuse_if_none_usable(source: Source, records: Sequence[FrameRecord]) -> None:
    """Refuse an input of which no frame could be used, or that was changed while it was read.

    Then nothing is to be written.
    """
    source.check_unchanged()
    if records and all(record.before is None for record in records):
        raise InputError(f"{source.name}: no frame could be used: {records[0].message}")


def prim_records(
    source: Source, rest_intersections: Sequence[int | None] = ()
) -> tuple[PrimRecord, ...]:
    """Describe the meshes of an input for a report."""
    counts = [*rest_intersections, *[None] * len(source.meshes)]
    return tuple(
        PrimRecord(
            path=mesh.path,
            vertices=len(mesh.rest),
            triangles=len(mesh.faces),
            rest_intersections=count,
        )
        for mesh, count in zip(source.meshes, counts, strict=False)
    )


def stretches(source: Source, mesh: SourceMesh, time: float) -> tuple[float, float]:
    """Return the least and the largest factor from lengths of a mesh to stage units.

    Raises FrameError where its transform is none.
    """
    corners = source.to_world(mesh, time, np.concatenate([np.zeros((1, 3)), np.eye(3)]))
    found = np.linalg.svd(corners[1:] - corners[0], compute_uv=False)
    return float(found.min()), float(found.max())


def told_unit(source: Source, mesh: SourceMesh, time: float) -> float:
    """Return how many stage units a length of a mesh is told as; 1 of a transform that is none."""
    from usd_io import FrameError

    try:
        return stretches(source, mesh, time)[1] or 1.0
    except (FrameError, np.linalg.LinAlgError):
        return 1.0


def told_size(source: Source, mesh: SourceMesh, time: float, points: NDArray[Any]) -> float:
    """Return the diagonal of the box of points (V, 3) of a mesh, local space, in stage units."""
    from dtrepair.numerics.geometry import diagonal

    return told_unit(source, mesh, time) * diagonal(points)


def mode_warnings(source: Source, mode: str) -> list[str]:
    """A warning where a mode leaves nothing to count."""
    if mode != "inter" or len(source.meshes) > 1:
        return []
    return ["--mode inter: only one mesh is selected, so that no contact counts"]


def make_counter(
    source: Source,
    *,
    mode: str,
    device: str,
    ignored: Sequence[tuple[int, int]] = (),
    attachments: Attachments | None = None,
) -> SceneCounter:
    """Return a counter of the meshes in the space that `read_frames` gives them.

    What was modelled, `attachments`, is counted apart.
    """
    from dtrepair.intersect.scene_counts import SceneCounter

    time = placing_time(source, source.times)
    several = len(source.meshes) > 1
    rests = [source.to_world(m, time, m.rest) if several else m.rest for m in source.meshes]
    faces = [mesh.faces for mesh in source.meshes]
    return SceneCounter(
        rests, faces, mode=mode, ignored=ignored, device=device, attachments=attachments
    )


def count_frame(counter: SceneCounter, frame: Frame) -> tuple[Frame, SceneCount | None]:
    """Count a frame; None for an unusable one, which a frame becomes that has collapsed."""
    from dtrepair.intersect.ignored import CollapsedPoseError

    if not frame.usable:
        return frame, None
    try:
        return frame, counter(frame.spaces, hidden=frame.hidden)
    except CollapsedPoseError as error:
        return Frame(frame.time, failure=str(error)), None


def side_by_side(
    function: Callable[[Item], Result], items: Iterable[Item], *, jobs: int | None
) -> Iterator[tuple[Item, Result]]:
    """Apply `function` to items on `jobs` threads; results in order, memory bounded by `jobs`.

    None: as many as there are processors.
    """
    from dtrepair.repair.parallel.worker_pool import available_processors

    jobs = jobs or available_processors()
    if jobs == 1:
        for item in items:
            yield item, function(item)
        return
    waiting: deque[tuple[Item, Future[Result]]] = deque()
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        try:
            for item in items:
                waiting.append((item, pool.submit(function, item)))
                if len(waiting) > jobs:
                    first, future = waiting.popleft()
                    yield first, future.result()
            while waiting:
                first, future = waiting.popleft()
                yield first, future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
