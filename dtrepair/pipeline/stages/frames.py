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
from dtrepair.pipeline.stages.sources import Source, SourceMesh, placing_time
from dtrepair.report.record import FrameRecord, PrimRecord
from dtrepair.wording import frame_list

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
    """

    time: float
    points: tuple[NDArray[np.float32], ...] = ()
    spaces: tuple[NDArray[Any], ...] = ()
    failure: str | None = None
    blocked: str | None = None

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
    spaces: list[NDArray[Any]] = []
    for mesh in source.meshes:
        try:
            local = source.read(mesh, time)
            if local is None:
                return Frame(time, blocked=mesh.path)
            points.append(local)
            several = len(source.meshes) > 1
            spaces.append(source.to_world(mesh, time, local) if several else local)
        except FrameError as error:
            return Frame(time, failure=str(error))
    return Frame(time, tuple(points), tuple(spaces))


class AtOnePlace:
    """Meshes of which all points lie at one place in a frame, as where a scale of zero hides them.

    Vertices at one place are one vertex, so that nothing of such a mesh is counted.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self._times: dict[str, list[float]] = {}

    def among(self, frames: Iterable[Frame]) -> Iterator[Frame]:
        """Pass frames on, and remember the meshes."""
        for frame in frames:
            for mesh, space in zip(self._source.meshes, frame.spaces, strict=False):
                points = np.asarray(space, dtype=np.float32)
                if len(mesh.faces) > 1 and (points == points[:1]).all():
                    self._times.setdefault(mesh.path, []).append(frame.time)
            yield frame

    @property
    def warnings(self) -> tuple[str, ...]:
        """What there is to tell of them, once they have passed."""
        return tuple(
            f"{path}: all points are at one place{_in_frames(times)}, so that nothing of it is "
            "counted there; where it should be seen, mend its points or its scale"
            for path, times in self._times.items()
        )


def _in_frames(times: Sequence[float]) -> str:
    """Return frames in a sentence; the default time needs no word."""
    numbered = [time for time in times if not math.isnan(time)]
    noun = "frame" if len(numbered) == 1 else "frames"
    return f" in {noun} {frame_list(numbered)}" if numbered else ""


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
        return frame, counter(frame.spaces)
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
