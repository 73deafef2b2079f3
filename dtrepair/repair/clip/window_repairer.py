"""A window of frames repaired: holds as one frame, bodies that never meet each for themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import frame_units
from dtrepair.numerics.work import counted
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.frames import Frame, without_holds
from dtrepair.repair.clip.mend_frames import dirty_share
from dtrepair.repair.clip.steady_frames import agreed
from dtrepair.repair.clip.window_method import MakeMethod
from dtrepair.repair.frame.bounded_frames import bounded_frames
from dtrepair.repair.parallel.worker_pool import (
    WorkerPool,
    side_by_side,
    with_workers,
    worthwhile_jobs,
)
from dtrepair.repair.relief.followers import with_followers
from dtrepair.repair.relief.inside_out import from_themselves, inside_out, outer_sides_first
from dtrepair.repair.relief.opening import opened_frames
from dtrepair.repair.relief.other_ways import frames_off, left_over, on_other_ways, with_turns
from dtrepair.repair.relief.props import machine_kept_whole, props_back, with_props
from dtrepair.repair.relief.relief import relieved_poses
from dtrepair.repair.relief.starting_again import started_again
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.holding import is_tied
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.separation.groups import faulty_bodies, groups_meet, groups_of_bodies
from dtrepair.repair.separation.starts import Solved, Starts
from dtrepair.repair.single_poses import solved_pose

Progress = Callable[[float], None]


class WindowRepairer:
    """Repairs windows of frames of a scene.

    Args:
        meshes: The welded meshes of the scene.
        options: Numbers of this stage.
        make_method: Makes the solver of windows of a mesh.
        jobs: Workers; None: all processors.
        progress: Called now and then with how many frames' worth of the present window is done.
    """

    def __init__(
        self,
        meshes: WeldedMeshes,
        *,
        options: ClipOptions,
        make_method: MakeMethod,
        jobs: int | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.meshes, self.options = meshes, options
        self.make_method, self.jobs, self.progress = make_method, jobs, progress
        self._spread = partial(side_by_side, jobs=jobs)
        # What of a window is done, told, and which share of it a present frame stands for.
        self._done, self._told, self._worth = 0.0, 0.0, 1.0
        self._work = 0.0  # of solving, see `numerics.work`

    def __call__(self, frames: list[Frame]) -> tuple[list[Judged], WeldedMeshes]:
        """Return the repaired poses of a window within the bounds, and the meshes they are of.

        Those are of the whole scene, perhaps with props that are rigid.
        """
        scene, self._told = self.meshes.scene, 0.0
        groups = groups_of_bodies(scene, [frame.centred for frame in frames])
        if groups != [tuple(range(len(scene.bodies)))]:
            found = self._by_groups(frames, groups)
            if not groups_meet(scene, groups, [own.points for own in found[0]]):
                return found
        self._done = 0.0
        return self._repaired(self.meshes, frames, 1.0)

    def _by_groups(
        self, frames: list[Frame], groups: Sequence[tuple[int, ...]]
    ) -> tuple[list[Judged], WeldedMeshes]:
        """Return the poses of groups of bodies, each repaired as if there were no others."""
        judged, rigid = [Judged(frame.centred) for frame in frames], set[int]()
        faulty = faulty_bodies(self.meshes.scene, frames)
        for number, bodies in enumerate(groups):
            # With a clearance a pose without pairs may have to move as well.
            if self.meshes.scene.options.clearance == 0.0 and faulty.isdisjoint(bodies):
                continue
            parts, meshes = self.meshes.of_bodies(bodies)
            opened = side_by_side(parts.opened, frames, jobs=self.jobs)
            self._done = number / len(groups) * len(frames)
            own, taken = self._repaired(meshes, opened, 1.0 / len(groups))
            rigid |= {bodies[k] for k, body in enumerate(taken.scene.bodies) if body.rigid}
            judged = [parts.joined(*both) for both in zip(judged, own, strict=True)]
        return judged, self.meshes.with_rigid(rigid)

    def _repaired(
        self, meshes: WeldedMeshes, frames: list[Frame], share: float
    ) -> tuple[list[Judged], WeldedMeshes]:
        """Return the repaired poses of bodies, and the meshes they are of.

        share: which one of all work on the window that is.
        """
        judged, taken = self._on_all_ways(meshes.without_clearance, frames, share)
        if meshes.scene.options.clearance > 0.0:
            rigid = {k for k, body in enumerate(taken.scene.bodies) if body.rigid}
            taken = meshes.with_rigid(rigid)
            mesh, times = taken([frame.sewn for frame in frames]), _times(frames)
            numbers = self.options.independent.opening
            judged = opened_frames(
                taken.scene, mesh, frames, judged, times, jobs=self.jobs, options=numbers
            )
        return judged, taken

    def _on_all_ways(
        self, meshes: WeldedMeshes, frames: list[Frame], share: float, effort: float = 1.0
    ) -> tuple[list[Judged], WeldedMeshes]:
        """Return the same, without a clearance.

        effort: how much work is enough for other ways to end, next to what usually is. That on the
            outer sides of shells counts.
        """
        ways = self.options.ways
        if not any(frame.wrong for frame in frames):
            return [Judged(frame.centred) for frame in frames], meshes
        solved, place = without_holds(frames, longest=self.options.longest_hold)
        tied = is_tied(meshes.scene)
        worth = self._worth = share * len(frames) / len(solved)
        # Attached parts take their garments along from the start: through a coat that is free limbs
        # are pushed, and what that strains is solved twice.
        usual = (meshes.dressed if tied else None) or meshes
        found, numbers = None, self.options.independent
        if self.meshes.scene.options.clearance == 0.0:  # Else what is rigid makes no room.
            found = machine_kept_whole(usual, solved, self._judged, ways, self.options.machine)
        most = self._work + effort * ways.enough_work(meshes.scene, len(solved))

        def enough() -> bool:
            return tied and self._work > most

        def on_all_ways(sides: WeldedMeshes, opened: list[Frame]) -> list[Judged]:
            return self._on_all_ways(sides, opened, share, effort / 2.0)[0]

        def left(frame: Frame) -> tuple[int, ...]:
            return left_over(meshes.scene, [frame], self._judged(usual, [frame]))

        if found is None:
            solved = outer_sides_first(meshes, solved, on_all_ways, left, self._spread)
            self._worth = worth  # The outer sides told theirs.
            found = with_props(usual, solved, self._judged, options=ways)
        judged, taken = found
        if tied and not enough():
            judged = from_themselves(meshes.scene, solved, judged, partial(self._judged, taken))
        limits = self._judged, enough
        judged, taken = on_other_ways(taken, solved, judged, *limits, options=ways)
        judged = with_turns(taken, solved, judged, *limits, options=ways)
        rigid = [k for k, body in enumerate(taken.scene.bodies) if body.rigid]
        meshes = meshes.with_rigid(rigid) if tied else taken
        times = _times(solved)
        judged = props_back(meshes.scene, solved, judged, times, options=numbers.props_back)
        judged = with_followers(meshes.scene, solved, judged, times, options=numbers.followers)
        return [judged[index] for index in place], meshes

    def _judged(self, meshes: WeldedMeshes, frames: list[Frame]) -> list[Judged]:
        """Return the repaired poses of a window within the bounds.

        Garments are tied to what they lie over where pushing cannot lead them apart, or they come
        off, and that leaves less. Attached parts are asked frame by frame, see `on_other_ways`.
        """
        scene, ways, dressed = meshes.scene, self.options.inside_out, None
        starts = [frame.begun or frame for frame in frames]
        own, opened = inside_out(meshes, starts, self._poses, self._spread, options=ways)
        parts = own.scene, own([frame.sewn for frame in frames]), opened
        tied = None if is_tied(scene) else meshes.dressed
        solved = self._solved(*parts, unless_stuck=tied is not None)
        if tied is not None and (solved is None or frames_off(scene, frames, solved.poses)):
            dressed = self._judged(tied, frames)
            if not any(left_over(scene, frames, dressed)):
                return dressed
        judged = self._bounded(meshes, frames, solved or self._solve(*parts))
        if dressed is None or left_over(scene, frames, judged) <= left_over(scene, frames, dressed):
            return judged
        return dressed

    def _bounded(self, meshes: WeldedMeshes, frames: list[Frame], solved: Solved) -> list[Judged]:
        """Return solved poses (V, 3) of a window, with less strain if possible, within bounds."""
        scene, numbers = meshes.scene, self.options.independent
        mesh = meshes([frame.sewn for frame in frames])
        solving, rest = self.options.solving, 1.0 - self.options.solving
        self._tell(solving, len(frames))
        poses, leads = solved
        poses = relieved_poses(scene, mesh, frames, poses, jobs=self.jobs, options=numbers.relief)
        self._tell(solving + rest / 3, len(frames))
        alone = partial(solved_pose, scene, meshes, options=numbers)
        again = started_again(
            scene,
            mesh,
            frames,
            poses,
            leads=leads,
            # Frames of attached parts were solved alone already.
            alone=alone if mesh.surface.ties is None else None,
            jobs=self.jobs,
            options=self.options.borrow,
        )
        times = np.array([frame.time for frame in frames])
        self._tell(solving + 2 * rest / 3, len(frames))
        options = self.options.agree
        again = agreed(scene, mesh, frames, poses, again, times, jobs=self.jobs, options=options)
        return bounded_frames(scene, frames, again, times, options=numbers.share)

    def _tell(self, share: float, frames: float) -> None:
        """Tell that this share of the work on so many frames is done; on another way it waits."""
        self._told = max(self._told, self._done + share * frames * self._worth)
        if self.progress is not None:
            self.progress(self._told)

    def _poses(self, scene: Scene, mesh: WeldedMesh, frames: list[Frame]) -> list[FloatArray]:
        """Return repaired poses (V, 3) of a window."""
        return self._solve(scene, mesh, frames).poses

    def _solve(self, scene: Scene, mesh: WeldedMesh, frames: list[Frame]) -> Solved:
        """Return what is found for a window."""
        found = self._solved(scene, mesh, frames, unless_stuck=False)
        assert found is not None
        return found

    def _solved(
        self, scene: Scene, mesh: WeldedMesh, frames: list[Frame], *, unless_stuck: bool
    ) -> Solved | None:
        """Return what is found for a window; None where pushing is stuck and may end so."""
        options, times = self.options.independent, _times(frames)
        starts = Starts(
            scene,
            mesh,
            frames,
            times,
            release=options.release,
            lift=options.lift,
            sunken=options.sunken,
            separation=options.separation,
        )
        if mesh.surface.ties is not None:
            return self._solve_tied(mesh, starts)
        otherwise: list[FloatArray] = []
        stuck = False
        # A memory must not take what was found where it went on for what ended here.
        first = mesh.on_way("unless stuck") if unless_stuck else mesh

        def unless(left: list[IntArray]) -> bool:
            """Return whether it ends there: stuck, or sheets and what is left can be led apart."""
            nonlocal stuck
            share = dirty_share(left, [frame.pairs for frame in frames])
            stuck = unless_stuck and share > self.options.windows.lend.share
            poses = None if stuck else starts.otherwise(left)
            otherwise.extend([] if poses is None else [poses])
            return stuck or poses is not None

        led = starts.unlifted(starts.led)
        found = self._solve_from(first, starts.led, times, led, unless=unless)
        if found is None and not stuck:
            led = starts.unlifted(otherwise[0])
            found = self._solve_from(mesh, otherwise[0], times, led)
        return None if found is None else Solved(found, led - starts.inputs)

    def _solve_tied(self, mesh: WeldedMesh, starts: Starts) -> Solved:
        """Return what is found for attached parts, frames that stay dirty solved again.

        Each frame is solved for itself, so that the others need not be solved along.
        """
        led = starts.unlifted(starts.led)
        found = self._solve_from(mesh, starts.led, starts.times, led)
        assert found is not None
        left = self._left_of(mesh, found)
        numbers = list(map(len, left))
        dirty = np.array(numbers) > 0
        runs = self.options.ways.again(dirty, numbers, len(mesh.surface.faces))
        otherwise = starts.otherwise(left) if runs else None
        if otherwise is None:
            return Solved(found, led - starts.inputs)
        unlifted = starts.unlifted(otherwise)
        for run in runs:
            own = starts.times[run], unlifted[run]
            again = self._solve_from(mesh, otherwise[run], *own)
            assert again is not None
            both = zip(again, self._left_of(mesh, again), strict=True)
            for index, (pose, other) in enumerate(both, start=run.start):
                if len(other) < len(left[index]):
                    found[index], led[index] = pose, unlifted[index]
        return Solved(found, led - starts.inputs)

    def _left_of(self, mesh: WeldedMesh, poses: list[FloatArray]) -> list[IntArray]:
        """Return the pairs that solving left of poses (V, 3)."""
        units = list(map(mesh.reduced, poses))
        return side_by_side(mesh.surface.contacts.pairs, units, jobs=self.jobs)

    def _solve_from(
        self,
        mesh: WeldedMesh,
        starts: FloatArray,
        times: FloatArray,
        inputs: FloatArray,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> list[FloatArray] | None:
        """Return repaired poses (V, 3) of starts (T, V, 3); None where `unless` ended it.

        inputs: the starts (T, V, 3) without the lifts of layers.
        """
        led = base = np.stack(list(map(mesh.reduced, starts)))
        if moved := not np.array_equal(starts, inputs):
            base = np.stack(list(map(mesh.reduced, inputs)))
        jobs = worthwhile_jobs(self.jobs, len(starts), len(mesh.surface.faces))

        def solved(pool: WorkerPool) -> FloatArray | None:
            pool.progress = lambda done: self._tell(self.options.solving, done)
            return self.make_method(mesh)(led, times, pool, base if moved else None, unless=unless)

        found, work = counted(partial(with_workers, mesh.surface, jobs, solved))
        self._work += work
        if found is None:
            return None
        return [mesh.expanded(*each) for each in zip(inputs, base, found, strict=True)]


def _times(frames: list[Frame]) -> FloatArray:
    return frame_units(np.array([frame.time for frame in frames]))
