"""Strained characters are relaxed once more, attached parts held, before shares are given up.

A correction that opens a contact may let a joint slide or turn a crease over by little more than
its bound. Where a share of it was given up for that, the contact would come back. As-rigid-as-
possible cycles between gaps that stay open, pulled to where attached parts are in their places,
mostly lead within the bounds, and nothing is given up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.work import work_done
from dtrepair.repair.full.acceptance import reach_of
from dtrepair.repair.full.relax import Relaxation, RelaxOptions
from dtrepair.repair.parallel.worker_pool import WorkerPool, with_workers, worthwhile_jobs
from dtrepair.repair.relief.small_parts import SmallPartOptions, SmallParts
from dtrepair.repair.relief.swelling import ROUNDING, with_volume
from dtrepair.repair.relief.wholes import with_wholes
from dtrepair.repair.scene.bounds import badness, strain_of
from dtrepair.repair.scene.holding import Holding
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.surface.defects import contact_scale
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class ReliefOptions:
    """How strained poses are relaxed once more.

    Args:
        cycles: At most so many.
        patience: After so many that gained nothing the pull changes, or it ends.
        gain: A cycle gains if it lowers the strain to this factor of the least before.
        hold: Weights, next to the edges, of the pull to where attached parts are in their places,
            in turn; a second way starts again where the first leaves the pose strained. Under a
            strong one joints close, under a weak one shapes recover and contacts make way.
        work, work_a_triangle: After so much of it, plus this for each triangle, times the effort, a
            pose is left as it is (units of `numerics.work`).
        wholes: So many parts that lost their shapes are tried as wholes: pins, buttons and teeth
            come back, limbs do not.
        farther: Factor of the longest motion of a correction that it may grow by.
        small_parts: How rivets, knuckles and pins are led back to what they are attached to.
        relax: The cycles. Short steps and many tries: what is strained lies beside contacts.
    """

    cycles: int = 60
    patience: int = 4
    gain: float = 0.99
    hold: tuple[tuple[float, ...], ...] = ((20.0, 8.0, 2.0, 0.5), (2.0, 0.5))
    work: float = 8e5
    work_a_triangle: float = 24.0
    wholes: int = 8
    farther: float = 1.1
    small_parts: SmallPartOptions = SmallPartOptions()
    relax: RelaxOptions = field(
        default_factory=lambda: RelaxOptions(step=0.005, first=1.0, longer=1.0, tries=10)
    )


class _Strained(NamedTuple):
    """A pose (V, 3) of the input, and what was found for it."""

    before: FloatArray
    after: FloatArray


class Relief:
    """Strained poses of a scene; a pool calls `relieved`.

    Args:
        scene: The bodies; some are attached.
        mesh: The mesh that was solved.
        strained: The poses.
        options: The numbers.
    """

    def __init__(
        self,
        scene: Scene,
        mesh: WeldedMesh,
        strained: Sequence[_Strained],
        *,
        options: ReliefOptions = ReliefOptions(),
    ) -> None:
        self.scene, self.mesh, self.surface = scene, mesh, mesh.surface
        self.strained, self.options, self.holding = strained, options, Holding(scene)

    def relieved(self, surface: Surface, index: int) -> FloatArray:
        """Return a pose (V, 3) that is less strained, with no more pairs, if there is one."""
        strained = self.strained[index]
        best, value = strained.after, self._strain(strained.before, strained.after)
        most = self.options.work + self.options.work_a_triangle * len(surface.faces)
        enough = work_done() + self.scene.options.effort * most
        for holds in self.options.hold:
            found, least = self._led(surface, strained, list(holds), enough)
            if least < value:
                best, value = found, least
            if not value[0] or work_done() > enough:
                break
        return best

    def _led(
        self, surface: Surface, strained: _Strained, holds: list[float], enough: float
    ) -> tuple[FloatArray, tuple[bool, float]]:
        """Return the least strained pose (V, 3) on one way from what was found, and its strain.

        holds: weights of the pull, in turn; enough: total work after which it ends.
        """
        before, after = strained
        options, mesh = self.options, self.mesh
        unit, start = mesh.reduced(before), mesh.reduced(after)
        best, value = after, self._strain(before, after)
        reach = reach_of(surface, start - unit)
        if not reach.any():
            return best, value  # only what is rigid moved
        state = Relaxation(
            surface,
            unit,
            start,
            len(surface.contacts.folds(start)),
            reach,
            contact_scale(surface, surface.contacts.pairs(unit)),
            options.relax,
            crossings=len(surface.contacts.pairs(start)),
        )
        farthest = self._farthest(strained)
        points, stalled = after, 0
        for _ in range(options.cycles):
            home = points + self.holding(before, points)
            state.system.hold(mesh.reduced(home), holds[0])
            state.cycle()
            points = mesh.expanded(before, unit, state.points)
            strain = self._strain(before, points)
            gained = strain < (value[0], options.gain * value[1])
            stalled = 0 if gained else stalled + 1
            if strain < value and float(lengths(points - before).max()) <= farthest:
                best, value = points, strain
            if not any(value) or (stalled == options.patience and len(holds) == 1):
                break
            if work_done() > enough:
                break
            if stalled == options.patience:
                stalled, holds = 0, holds[1:]
        return best, value

    def _strain(self, before: FloatArray, points: FloatArray) -> tuple[bool, float]:
        """Return whether a pose (V, 3) is strained, and how far it is beyond the strict bounds."""
        strict = strain_of(self.scene, before, points, strict=True)
        strained = bool(strict) and bool(strain_of(self.scene, before, points))
        return strained, badness(strict)

    def _farthest(self, strained: _Strained) -> float:
        """Return how far a vertex may move."""
        farthest = self.options.farther * float(lengths(strained.after - strained.before).max())
        if (limit := self.scene.options.maximum_displacement) is not None:
            farthest = min(farthest, limit * (1.0 - ROUNDING))
        return farthest


def relieved_poses(
    scene: Scene,
    mesh: WeldedMesh,
    poses: Sequence[OpenedPose],
    found: list[FloatArray],
    *,
    jobs: int | None = 1,
    options: ReliefOptions = ReliefOptions(),
) -> list[FloatArray]:
    """Return what was `found` (V, 3) for some poses, with less strain where that can be had.

    Of characters with attached parts only. Nothing gets more pairs. jobs: workers; None: one a
    processor. Raises WorkerLost.
    """
    if scene.attachments is None or mesh.surface.ties is None:
        return found
    result, small_parts = [], SmallParts(scene, options=options.small_parts)
    for pose, own in zip(poses, found, strict=True):
        whole = with_wholes(scene, pose, own, most=options.wholes)
        result.append(with_volume(scene, pose, small_parts(pose, whole)))
    strained = {}
    for index, (pose, points) in enumerate(zip(poses, result, strict=True)):
        excess = strain_of(scene, pose.centred, points, strict=True)
        # What came off cannot be relaxed back on.
        if any(own.kind != StrainKind.WORN for own in excess):
            strained[index] = _Strained(pose.centred, points)
    if not strained:
        return result
    state = Relief(scene, mesh, list(strained.values()), options=options)

    def relieved_by(pool: WorkerPool) -> list[FloatArray]:
        pool.start(state)
        return list(pool.map("relieved", range(len(strained))))

    jobs = worthwhile_jobs(jobs, len(strained), len(mesh.surface.faces))
    relieved = with_workers(mesh.surface, jobs, relieved_by)
    for (index, was), points in zip(strained.items(), relieved, strict=True):
        pose = poses[index]
        if len(scene.pairs(points, pose.weld)) <= len(scene.pairs(was.after, pose.weld)):
            result[index] = with_volume(scene, pose, points)
    return result
