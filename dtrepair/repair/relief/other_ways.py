"""Other ways through frames of a clip that are not clean: strained props rigid, other creases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.temporal import runs_of
from dtrepair.repair.scene.bounds import Judged, came_off, faults_left, wrong_in
from dtrepair.repair.scene.holding import is_tied
from dtrepair.repair.scene.opened_pose import OpenedPose, Pose, detected
from dtrepair.repair.scene.props import bent_bodies
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes

# Solves frames by the meshes of a way, within the bounds.
Judge = Callable[[WeldedMeshes, list[Pose]], list[Judged]]


@dataclass(frozen=True, kw_only=True)
class OtherWayOptions:
    """Which other ways are taken.

    Args:
        farther, near: Those on which nothing moves farther than so many times what it did on the
            first, and this fraction of the diagonal.
        far: Where something moves so far, diagonals, with props rigid, bending them is tried.
        few, share: Of attached parts, whose frames are solved each for itself, at most so many
            frames of a window, or this share of it, are solved again: those with least left. With
            their garments held, and where joints turn, as many as are strained.
        nearly: Frames of attached parts with at most so many pairs and parts inside others, both
            together, go ways on which other creases are shared.
        probes, helped: Ways that other creases or other garments make are tried on so many frames,
            those with least left, and on the others where at most this share of it stays.
        large: Scenes of more triangles get fewer frames by that ratio, but one at least; ...
        more: ... those of fewer get more, up to this factor.
        work, work_a_triangle: Frames of attached parts begin no other way once solving took so much
            work, and so much for each triangle of the scene, times the effort, in the mean of the
            frames of their window (units of `numerics.work`).
    """

    farther: float = 2.0
    near: float = 0.01
    far: float = 0.02
    few: int = 3
    share: float = 0.25
    nearly: int = 60
    probes: int = 2
    helped: float = 0.5
    large: int = 20_000
    more: float = 2.0
    work: float = 2e6
    work_a_triangle: float = 60.0

    def enough_work(self, scene: Scene, frames: int) -> float:
        """Return the work on a window of so many frames after which no other way begins."""
        a_frame = self.work + self.work_a_triangle * len(scene.faces)
        return scene.options.effort * a_frame * frames

    def much_farther(self, most: float, than: float) -> bool:
        """Return whether the farthest move of one way is much farther than that of another.

        most, than: of both, diagonals. A rigid cuff comes off its arm, and is clean.
        """
        return most > self.farther * than + self.near

    def again(
        self,
        chosen: NDArray[np.bool_],
        left: Sequence[int],
        triangles: int,
        *,
        most: int | None = None,
    ) -> list[slice]:
        """Return the runs of the chosen frames (T,) that are solved again.

        left: how many pairs each frame has left; triangles: how many the scene has; most: so many
        frames of a scene of `large` triangles; default: those of the options.
        """
        usual = max(self.few, int(self.share * len(chosen))) if most is None else most
        number = max(1, round(usual * min(self.more, self.large / max(triangles, 1))))
        order = np.lexsort((np.asarray(left), ~chosen))[:number]
        return runs_of(chosen & np.isin(np.arange(len(chosen)), order))


def on_other_ways(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judged: list[Judged],
    judge: Judge[Pose],
    worked_enough: Callable[[], bool],
    *,
    options: OtherWayOptions = OtherWayOptions(),
) -> tuple[list[Judged], WeldedMeshes]:
    """Return better poses of a window where another way leaves less, and the meshes of its way.

    Frames of attached parts, which are solved each for itself, go another way alone, and also where
    something is left in them: a prop that bends within the bounds elsewhere is left at that.
    worked_enough: whether no other way of theirs begins, as so much work was done.
    """
    scene, taken, result = meshes.scene, meshes, judged
    if is_tied(scene):
        return _each_on_its_way(meshes, frames, judged, judge, worked_enough, options), meshes
    if not any(found.lowered for found in judged):
        return judged, meshes
    bent = [bent_bodies(scene, found) for found in judged]
    for way in meshes.otherwise(bent, [frame.centred for frame in frames]):
        other = judge(way, list(frames))
        fewer = sum(_left(scene, frames, other)) < sum(_left(scene, frames, result))
        moved = (farthest_move(scene, frames, own) for own in (other, result))
        if fewer and not options.much_farther(*moved):
            result, taken = other, way
    return result, taken


def _each_on_its_way(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judged: list[Judged],
    judge: Judge[Pose],
    worked_enough: Callable[[], bool],
    options: OtherWayOptions,
) -> list[Judged]:
    """Return poses of attached parts, each on the way that leaves least of what is wrong."""
    scene, result = meshes.scene, list(judged)
    wrong = np.array(faults_left(scene, frames, judged))

    def take(
        way: WeldedMeshes,
        chosen: NDArray[np.bool_],
        *,
        farther: bool = False,
        most: int | None = None,
    ) -> NDArray[np.bool_]:
        """Solve the chosen frames (T,) that are not clean, as many as may be; return which.

        farther: whether they may go much farther: the first way may have left what is as mobile.
        most: see `OtherWayOptions.again`.
        """
        count, tried = len(scene.faces), np.zeros(len(frames), dtype=bool)
        for run in options.again(chosen & (wrong > 0), wrong.tolist(), count, most=most):
            if worked_enough():
                break
            own, tried[run] = frames[run], True
            other = judge(way, list(own))
            left = faults_left(scene, own, other)
            for place, pose, less in zip(range(run.start, run.stop), other, left, strict=True):
                frame = frames[place : place + 1]
                moved = (farthest_move(scene, frame, [own]) for own in (pose, result[place]))
                if less < wrong[place] and (farther or not options.much_farther(*moved)):
                    result[place], wrong[place] = pose, less
        return tried

    def probe(way: WeldedMeshes, chosen: NDArray[np.bool_], *, most: int | None = None) -> None:
        """Take the chosen frames (T,) with least left, and the others only where that helped."""
        before, left = wrong.copy(), np.where(chosen & (wrong > 0), wrong, np.inf)
        first = np.isin(np.arange(len(left)), np.argsort(left, kind="stable")[: options.probes])
        tried = take(way, first & chosen, farther=True, most=options.probes)
        if wrong[tried].sum() <= options.helped * before[tried].sum():
            take(way, chosen & ~tried, farther=True, most=most)

    lowered = np.array([found.lowered for found in judged])
    if (lowered & (wrong > 0)).any():
        bent = [bent_bodies(scene, found) for found in judged]
        for way in meshes.otherwise(bent, [frame.centred for frame in frames]):
            take(way, lowered)
        if not scene.dressed and meshes.dressed is not None:
            take(meshes.dressed, lowered, farther=True, most=int(lowered.sum()))
    if scene.dressed and (wrong > 0).any():
        for own in (lowered, ~lowered):
            probe(meshes.undressed, own, most=len(frames))
    if ((wrong > 0) & (wrong <= options.nearly)).any():
        for way in meshes.creased:
            probe(way, wrong <= options.nearly)
    return result


def with_turns(
    meshes: WeldedMeshes,
    frames: Sequence[Pose],
    judged: list[Judged],
    judge: Judge[Pose],
    worked_enough: Callable[[], bool],
    *,
    options: OtherWayOptions = OtherWayOptions(),
) -> list[Judged]:
    """Return better poses where strained ones are less so if joints that turned are left alone.

    What such joints have in contact counts all the same in what is handed back, and what strained
    the frame stays told. In large scenes those with least left are tried (see `again`).
    worked_enough: see `on_other_ways`.
    """
    lowered = np.array([found.lowered for found in judged])
    turning = meshes.turning if lowered.any() and not worked_enough() else None
    if turning is None:
        return judged
    scene, result = turning.scene, list(judged)
    known = [detected(scene, replace(frame, detected=False, begun=None)) for frame in frames]
    # The others have no contact at a joint that turned.
    met = [own.wrong < frame.wrong for own, frame in zip(known, frames, strict=True)]
    chosen, before = lowered & np.array(met), _left(meshes.scene, frames, judged)
    for run in options.again(chosen, before, len(scene.faces), most=int(chosen.sum())):
        if worked_enough():
            break
        own, first = known[run], result[run]
        other = judge(turning, own)
        left = zip(_left(scene, own, other), _left(scene, own, first), strict=True)
        for index, (less, more) in enumerate(left):
            frame, found = frames[run][index], other[index]
            # What is no better than the input would be lost with all that is repaired elsewhere.
            gains = own[index].wrong == 0 or _left(meshes.scene, [frame], [found])[0] < frame.wrong
            if gains and (less, found.lowered) < (more, first[index].lowered):
                result[run.start + index] = first[index]._replace(points=found.points, turned=True)
    return result


def _left(scene: Scene, frames: Sequence[OpenedPose], judged: Sequence[Judged]) -> list[int]:
    """Return how many pairs are left in each pose."""
    both = zip(frames, judged, strict=True)
    return [len(scene.pairs(found.points, frame.weld)) for frame, found in both]


def left_over(
    scene: Scene, frames: Sequence[OpenedPose], judged: Sequence[Judged]
) -> tuple[int, int, int]:
    """Return with how many poses anything is wrong, how much, and in how many something came off.

    Deep frames draw the light ones along: what leaves more of these clean is better.
    """
    poses = [own.points for own in judged]
    wrong = wrong_in(scene, frames, poses)
    return sum(own > 0 for own in wrong), sum(wrong), frames_off(scene, frames, poses)


def frames_off(scene: Scene, frames: Sequence[OpenedPose], poses: Sequence[FloatArray]) -> int:
    """Return in how many poses (V, 3) something came off what it goes round."""
    return sum(came_off(scene, *both) for both in zip(frames, poses, strict=True))


def farthest_move(scene: Scene, frames: Sequence[OpenedPose], judged: Sequence[Judged]) -> float:
    """Return how far a vertex moves at most, diagonals."""
    both = zip(frames, judged, strict=True)
    most = max(float(lengths(found.points - frame.centred).max()) for frame, found in both)
    return most / scene.scale.diagonal(frames[0].centred)
