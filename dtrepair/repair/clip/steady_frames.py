"""Frames that stand out from their neighbours, moved to where these ask them to be.

What took another way in some frames of a window, after it was solved, is relaxed in step with the
frames around.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.temporal import (
    apply_in_time,
    frame_units,
    second_differences,
    spread_in_time,
    steady_weights,
)
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.frame.frame_options import FrameOptions
from dtrepair.repair.full.acceptance import reach_of
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import WorkerPool, with_workers, worthwhile_jobs
from dtrepair.repair.scene.bounds import strain_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh


@dataclass(frozen=True, kw_only=True)
class SteadyOptions:
    """Numbers of the steadying of frames that stand out.

    Args:
        rough: Root mean square second difference of a frame, units of the size, above which it is
            steadied: it is seen as a jump.
        rounds: At most so many.
        step: Largest motion in an iteration of the push that cleans a frame, units of the size.
        gain: A round must lower the roughness to this fraction to be followed by another.
    """

    rough: float = 1.5e-3
    rounds: int = 6
    step: float = 0.002
    gain: float = 0.97


def steady_frames(state: WindowState, *, options: SteadyOptions = SteadyOptions()) -> None:
    """Move frames that stand out to where their neighbours ask them to be, if still clean."""
    if len(state.frames) < 3:
        return
    weights, differences = steady_weights(state.frames), second_differences(state.frames)

    def roughness() -> FloatArray:
        second = apply_in_time(differences, state.poses - state.original)
        of_frames: FloatArray = np.sqrt((second**2).sum(axis=2).mean(axis=1))
        return of_frames

    now = roughness()
    for _ in range(options.rounds):
        before = np.linalg.norm(now)
        for colour in range(3):
            rough = np.zeros(len(state.frames), dtype=bool)
            rough[1:-1] = now > options.rough
            rough[:-1] |= rough[1:]
            rough[1:] |= rough[:-1]
            frames = np.flatnonzero(rough)
            frames = frames[frames % 3 == colour]
            if len(frames) and state.steady(frames.tolist(), weights, options.step):
                now = roughness()
        if np.linalg.norm(now) > options.gain * before:
            break


@dataclass(frozen=True, kw_only=True)
class AgreeOptions:
    """Numbers of the agreement of frames that took another way with those around them.

    Args:
        changed: Vertices took another way where that is farther than this, units of the size.
        rings: They agree, and what is around them, fading over so many edge rings, ...
        spread: ... and over frames as a bell of this standard deviation, ...
        around: ... up to so many frames before and after.
        faint: Vertices that would take part by less are left out.
        agreement: For each cycle of relaxing, the weight by which frames are pulled to where their
            neighbours ask them to be, next to the edges.
        still: Relaxing ends when no vertex moves farther in a cycle, units of the size.
        frames: The work on single frames.
    """

    changed: float = 1e-3
    rings: int = 10
    spread: float = 3.0
    around: int = 8
    faint: float = 0.05
    agreement: tuple[float, ...] = (3.0,) * 12
    still: float = 2e-4
    frames: FrameOptions = field(default_factory=FrameOptions)


def agreed(
    scene: Scene,
    mesh: WeldedMesh,
    frames: Sequence[OpenedPose],
    found: Sequence[FloatArray],
    poses: list[FloatArray],
    times: FloatArray,
    *,
    jobs: int | None = 1,
    options: AgreeOptions = AgreeOptions(),
) -> list[FloatArray]:
    """Return the poses (V, 3) of a window in step, where some are not what was found together.

    Only frames of a single skin are: its neighbours were pushed together, and it jitters where one
    goes another way. Those that still intersect or that it would strain stay as they are.

    Args:
        scene, mesh: What was solved.
        frames, found, poses: The input, what was found for it, and what is to be used.
        times: Of the frames (T,).
        jobs: Workers; None: one a processor.
        options: The numbers.

    Raises:
        WorkerLost: a worker ended.
    """
    changed = [index for index, (a, b) in enumerate(zip(found, poses, strict=True)) if a is not b]
    if not changed or len(frames) < 3 or scene.strain_meter.parts.count > 1:
        return poses
    near = slice(max(changed[0] - options.around, 0), changed[-1] + options.around + 1)
    before = [frame.centred for frame in frames[near]]
    units = frame_units(times)[near]
    relaxed = _relaxed(mesh, before, found[near], poses[near], units, jobs, options)
    result = list(poses)
    for index, own, points in zip(range(len(poses))[near], before, relaxed, strict=True):
        if not strain_of(scene, own, points) or strain_of(scene, own, poses[index]):
            result[index] = points
    return result


def _relaxed(
    mesh: WeldedMesh,
    before: Sequence[FloatArray],
    found: Sequence[FloatArray],
    poses: Sequence[FloatArray],
    times: FloatArray,
    jobs: int | None,
    options: AgreeOptions,
) -> list[FloatArray]:
    """Return poses (V, 3), relaxed in step around where they are not what was found."""
    surface = mesh.surface
    original, now = (np.stack(list(map(mesh.reduced, each))) for each in (before, poses))
    reach = np.zeros(now.shape[:2], dtype=np.float32)
    for index, (was, pose) in enumerate(zip(map(mesh.reduced, found), now, strict=True)):
        far = lengths(pose - was) > options.changed
        reach[index] = reach_of(surface, far[:, None].astype(float), rings=options.rings)
    reach = spread_in_time(times, reach, options.spread)
    reach[reach < options.faint] = 0.0

    def relaxed_by(pool: WorkerPool) -> FloatArray:
        numbers, farthest = options.frames, mesh.farthest
        state = WindowState(
            surface, original, times, pool, alone=solve_alone, farthest=farthest, options=numbers
        )
        state.place(now)
        taking = (f for f, pairs in enumerate(state.pairs) if not len(pairs) and reach[f].any())
        state.relax(
            list(taking), reach, options.agreement, still=options.still, spread=options.spread
        )
        return state.poses

    jobs = worthwhile_jobs(jobs, len(now), len(surface.faces))
    solved = with_workers(surface, jobs, relaxed_by)
    return [mesh.expanded(*each) for each in zip(before, original, solved, strict=True)]
