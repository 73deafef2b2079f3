"""What a report says of a repaired frame: counts, contacts of each pair of objects, who moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair import diagnosis
from dtrepair.diagnosis import Advice, Diagnosis, Status, merged, sentence
from dtrepair.numerics.geometry import FloatArray, IntArray, pair_keys, unique_edges
from dtrepair.pipeline.modelled.parts import ModelledParts
from dtrepair.pipeline.stages.frames import Frame, frame_time, told_size
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.record import (
    ContactRecord,
    FramePrimRecord,
    FrameRecord,
    MotionRecord,
    StageRecord,
)
from dtrepair.wording import counted, frames_named

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount
    from dtrepair.repair.result import RepairResult
    from dtrepair.repair.scene.bodies import Body

# What the choices of a run are called.
REMEDIES = {
    **diagnosis.REMEDIES,
    Advice.RAISE_MAXIMUM_DISPLACEMENT: "raise --maximum-displacement",
    Advice.TAKE_AT_ANY_COST: "take what is strained with --at-any-cost",
    Advice.RAISE_EFFORT: "raise --effort",
    Advice.RAISE_DIFFUSION: "raise --diffusion",
    Advice.CALL_ATTACHED: "take where joints turned to as modelled with --attach",
}


def clearance_warnings(records: Sequence[FrameRecord], clearance: float) -> tuple[str, ...]:
    """Say in a line in which frames pairs stay closer than a clearance, stage units, if any do."""
    close = [own for own in records if own.left.too_close]
    if not close:
        return ()
    worst = max(close, key=lambda own: own.left.too_close)
    times = [own.time for own in close if own.time is not None]
    where = f" in {frames_named(times)}" if times else ""
    most = f" in frame {worst.time:.10g}" if len(times) > 1 else ""
    return (
        f"--clearance {clearance:g} is not reached{where}: "
        f"{counted(worst.left.too_close, 'pair')} of triangles{most} closer than that: what is "
        "pinned, limited or thin, or would be strained, cannot make room; a smaller --clearance "
        "may be reached",
    )


class FrameRecorder:
    """Makes the records of frames; `bodies` are the meshes of `source` as they are repaired.

    modelled: names the parts whose contacts were modelled.
    """

    def __init__(self, source: Source, bodies: Sequence[Body], modelled: ModelledParts) -> None:
        self.source = source
        self.bodies = bodies
        self.modelled = modelled

    def __call__(
        self,
        frame: Frame,
        spaces: Sequence[NDArray[Any]],
        before: SceneCount,
        after: SceneCount,
        results: Sequence[RepairResult],
        seconds: dict[str, float],
    ) -> FrameRecord:
        """The record of a frame that ends as `spaces`, the points of each mesh."""
        from dtrepair.numerics.metrics import displacements

        old = [np.asarray(part, np.float64) for part in frame.spaces]
        new = [np.asarray(part, np.float64) for part in spaces]
        moved = [displacements(a, b) for a, b in zip(old, new, strict=True)]
        sizes = self.sizes(frame, old)
        status = _status(before, after, results)
        parts = self.modelled.in_frame(frame.time, before, frame.spaces, after, spaces)
        left = in_stage_units(merged(result.diagnosis for result in results), sizes)
        return FrameRecord(
            time=frame_time(frame),
            status=status,
            message=sentence(left, status, remedies=REMEDIES) if left else "",
            before=before.total,
            after=after.total,
            iterations=results[0].iterations,
            seconds=sum(seconds.values()),
            displacement_max=max(float(part.max()) for part in moved),
            displacement_mean=float(np.concatenate(moved).mean()),
            prims=self.prims(sizes, old, new, before, after),
            contacts=contact_records(self.source, before, after),
            modelled=parts.modelled,
            faults=parts.faults,
            stages=tuple(StageRecord(*astuple(stage)) for stage in results[0].stages),
            left=left,
            geodesic=self._geodesic(new, after),
            # A pose that stays where it was turns no normal.
            normal_consistency=(
                self._normal_consistency(old, new) if any(part.any() for part in moved) else 1.0
            ),
        )

    def prims(
        self,
        sizes: Sequence[float],
        old: Sequence[FloatArray],
        new: Sequence[FloatArray],
        before: SceneCount,
        after: SceneCount,
    ) -> tuple[FramePrimRecord, ...]:
        """The record of each mesh, from old to new points (V, 3); of several how they moved."""
        several, prims = len(old) > 1, []
        for index, mesh in enumerate(self.source.meshes):
            motion = self._motion(index, old[index], new[index]) if several else None
            counts = before.each[index], after.each[index]
            prims.append(FramePrimRecord(mesh.path, *counts, motion=motion, size=sizes[index]))
        return tuple(prims)

    def sizes(self, frame: Frame, poses: Sequence[FloatArray]) -> list[float]:
        """Diagonals of the meshes in stage units, which are those of a space that they share."""
        from dtrepair.numerics.geometry import diagonal

        if len(poses) > 1:
            return [diagonal(pose) for pose in poses]
        return [told_size(self.source, self.source.meshes[0], frame.time, poses[0])]

    def _geodesic(self, points: Sequence[FloatArray], count: SceneCount) -> float:
        """How far apart along a mesh triangles are that still intersect: the worst of all."""
        from dtrepair.numerics.geodesics import largest_geodesic

        if not count.total.pairs:
            return 0.0
        meant = np.isin(pair_keys(count.every_pair), pair_keys(count.modelled))
        left, start, found = count.every_pair[~meant], 0, 0.0
        for mesh, pose in zip(self.source.meshes, points, strict=True):
            own = left - start
            within = ((own >= 0) & (own < len(mesh.faces))).all(axis=1)
            found = max(found, largest_geodesic(pose, mesh.faces, own[within]))
            start += len(mesh.faces)
        return found

    def _normal_consistency(self, old: Sequence[FloatArray], new: Sequence[FloatArray]) -> float:
        """Mean over the triangles of all meshes, by their area."""
        from dtrepair.numerics.metrics import normal_consistency

        meshes, starts = self.source.meshes, np.cumsum([0, *(len(pose) for pose in old)])
        faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
        return normal_consistency(np.concatenate(old), np.concatenate(new), np.concatenate(faces))

    def _motion(self, index: int, old: FloatArray, new: FloatArray) -> MotionRecord | None:
        """How a mesh moved; None if it did not."""
        from dtrepair.numerics.geometry import diagonal
        from dtrepair.numerics.metrics import displacements, edge_log_ratio
        from dtrepair.repair.surface.rigid_bodies import RigidBodies

        moved = displacements(old, new)
        if not moved.any():
            return None
        whole = RigidBodies([(0, len(old))], np.ones(len(old)))
        rigid = np.linalg.norm(whole.fitted(old, new) - old, axis=1)
        rest, edges = np.asarray(self.bodies[index].rest, np.float64), self._edges[index]
        return MotionRecord(
            displacement_max=float(moved.max()),
            rigid_rms=float(np.sqrt((rigid**2).mean())) / (diagonal(old) or 1.0),
            edge_distortion=edge_log_ratio(rest, new, edges),
            edge_change=edge_log_ratio(old, new, edges),
        )

    @cached_property
    def _edges(self) -> list[IntArray]:
        return [unique_edges(mesh.faces) for mesh in self.source.meshes]


def in_stage_units(left: Diagnosis, sizes: Sequence[float]) -> Diagnosis:
    """Return what is left with lengths in stage units, given the diagonals of the meshes in them.

    Only a single mesh is repaired in a space of its own, which may be stretched.
    """
    if len(sizes) > 1 or not left.strains:
        return left
    return replace(left, strains=tuple(replace(own, size=sizes[0]) for own in left.strains))


def contact_records(
    source: Source, before: SceneCount, after: SceneCount
) -> tuple[ContactRecord, ...]:
    """Which of several meshes met, before and after; nothing for a single one."""
    if len(source.meshes) == 1:
        return ()
    paths = [mesh.path for mesh in source.meshes]
    return tuple(
        ContactRecord(paths[i], paths[j], before.met.get((i, j), 0), after.met.get((i, j), 0))
        for i, j in sorted({*before.met, *after.met})
    )


def _status(before: SceneCount, after: SceneCount, results: Sequence[RepairResult]) -> Status:
    first, last = before.total.pairs, after.total.pairs
    if any(result.status is Status.STRAINED for result in results):
        return Status.STRAINED
    if last:
        return Status.IMPROVED if last < first else Status.UNCHANGED
    # Nothing intersects, but something may lie wholly inside something else.
    if any(result.status is not Status.CLEAN and not result.after.pairs for result in results):
        return Status.IMPROVED if first else Status.UNCHANGED
    return Status.CLEAN
