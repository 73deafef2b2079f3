"""The stages of a window of frames: push, mend, tighten, steady, ease out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.temporal import gaussian_kernel
from dtrepair.repair.clip.mend_frames import (
    LendFramesOptions,
    MendFramesOptions,
    is_stuck,
    lend_frames,
    lend_nearer,
    mend_frames,
)
from dtrepair.repair.clip.push_frames import (
    KeyWindowOptions,
    PushFramesOptions,
    between_keys,
    keys_of,
    push_frames,
)
from dtrepair.repair.clip.restore_shape import (
    RelaxFramesOptions,
    RestoreShapeOptions,
    cure_frames,
    relax_frames,
    restore_shapes,
)
from dtrepair.repair.clip.steady_frames import SteadyOptions, steady_frames
from dtrepair.repair.clip.tighten_frames import (
    SettleFramesOptions,
    TightenOptions,
    settle_frames,
    shift_frames_back,
    tighten_frames,
)
from dtrepair.repair.clip.window_state import WindowState
from dtrepair.repair.frame.frame_options import Alone, FrameOptions
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.surface.surface import Surface


class WindowSolver(Protocol):
    """Repairs the frames of a window of one surface together, in units of its size."""

    def __call__(
        self,
        original: FloatArray,
        frames: FloatArray,
        pool: WorkerPool,
        inputs: FloatArray | None = None,
        *,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> FloatArray | None:
        """Return repaired poses (T, V, 3) at times in frame units, or None if `unless` holds.

        inputs: what `original` was before layers were lifted (T, V, 3); None: the same.
        """


# Makes the solver of the windows of a mesh.
MakeMethod = Callable[[WeldedMesh], WindowSolver]


@dataclass(frozen=True, kw_only=True)
class EaseOptions:
    """Numbers of the leaving out of faint displacements.

    Args:
        still: Displacements below this, units of the size, are left out; up to twice this they fade
            in: what is far from all contacts keeps every bit.
        rings: Around what that would close they come back, fading out over so many rings, try by
            try; then everywhere in the frame.
    """

    still: float = 1e-4
    rings: tuple[int, ...] = (3, 6)


@dataclass(frozen=True, kw_only=True)
class AttachedOptions:
    """Numbers of windows of attached parts, whose frames are first solved each for itself.

    A push of all frames together swings limbs: both sides of a contact hang on one host.

    Args:
        width: Standard deviation, in frames, over which corrections of single frames are smoothed.
        step: Largest motion in an iteration that cleans a frame again, units of the size.
        work: Fraction of the usual work on a window that this is, for the progress that is told.
    """

    width: float = 1.5
    step: float = 0.002
    work: float = 0.35


@dataclass(frozen=True, kw_only=True)
class WindowOptions:
    """Every number of the repair of a window of frames, stage by stage.

    Args:
        frames: The work on single frames, in all stages.
        push: All frames pushed together.
        keys: Windows that are solved at keys first.
        lend: Frames that pushing left dirty, where they are many: from their neighbours.
        mend: The same where they are few.
        tighten: Back towards the input.
        relax: Clean frames back towards the shapes of their inputs.
        steady: Frames that stand out from their neighbours.
        settle: What touches nothing back to its place.
        restore: Back to the shapes of bodies.
        ease: Faint displacements left out.
        attached: What is other where parts are attached.
    """

    frames: FrameOptions = field(default_factory=FrameOptions)
    push: PushFramesOptions = field(default_factory=PushFramesOptions)
    keys: KeyWindowOptions = field(default_factory=KeyWindowOptions)
    lend: LendFramesOptions = field(default_factory=LendFramesOptions)
    mend: MendFramesOptions = field(default_factory=MendFramesOptions)
    tighten: TightenOptions = field(default_factory=TightenOptions)
    relax: RelaxFramesOptions = field(default_factory=RelaxFramesOptions)
    steady: SteadyOptions = field(default_factory=SteadyOptions)
    settle: SettleFramesOptions = field(default_factory=SettleFramesOptions)
    restore: RestoreShapeOptions = field(default_factory=RestoreShapeOptions)
    ease: EaseOptions = field(default_factory=EaseOptions)
    attached: AttachedOptions = field(default_factory=AttachedOptions)


class WindowMethod:
    """Repairs windows of frames of one surface, in units of its size."""

    def __init__(
        self,
        surface: Surface,
        alone: Alone,
        *,
        tighten: int = 3,
        farthest: float | None = None,
        effort: float = 1.0,
        options: WindowOptions = WindowOptions(),
    ) -> None:
        """Use `alone` (surface, pose) for frames that stay dirty; `tighten` cycles at most.

        farthest: no vertex moves farther; effort: factor of the work after which mending ends.
        """
        self.effort = effort
        self.surface, self.alone, self.tighten = surface, alone, tighten
        self.farthest, self.options = farthest, options

    def __call__(
        self,
        original: FloatArray,
        frames: FloatArray,
        pool: WorkerPool,
        inputs: FloatArray | None = None,
        *,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> FloatArray | None:
        """Return the poses (T, V, 3) at times in frame units, repaired; some may stay dirty.

        inputs: what `original` was before layers were lifted (T, V, 3): lifts are smooth in time,
        so that frames beside deep ones have more of them than they need; that goes back.
        unless: asked with the pairs that pushing leaves; None is returned if it says so.
        """
        options = self.options
        led = None if inputs is not None else self._led_by_keys(original, frames, pool)
        state = self._state(original, frames, pool)
        if not state.dirty and inputs is None:
            return original
        keyed = led is not None and self._pushed_from(state, led)
        if not keyed:
            self._push(state)
        if state.dirty and unless is not None and unless(state.pairs):
            return None
        stuck = self._mend(state)
        state.given_up = frozenset(state.dirty)
        # A push needs its layers on their sides; what relaxes keeps them there.
        if inputs is not None:
            state.count_from(inputs)
        agreement = options.keys.agreement_between if keyed else None
        lifted = inputs is not None
        self._bring_back(state, stuck=stuck, lifted=lifted, tight=keyed, agreement=agreement)
        return eased(state, options=options.ease)

    def _state(self, original: FloatArray, frames: FloatArray, pool: WorkerPool) -> WindowState:
        """Return the frames (T, V, 3) of a window at times in frame units on their way."""
        return WindowState(
            self.surface,
            original,
            frames,
            pool,
            alone=self.alone,
            farthest=self.farthest,
            options=self.options.frames,
        )

    def _led_by_keys(
        self, original: FloatArray, frames: FloatArray, pool: WorkerPool
    ) -> FloatArray | None:
        """Return poses (T, V, 3) that move as solved keys do; None where that is not worth it."""
        options, surface = self.options.keys, self.surface
        # Between keys a vertex may go farther than at both of them.
        if surface.ties is not None or surface.clusters > 1 or self.farthest is not None:
            return None
        if len(frames) < options.frames:
            return None
        keys = keys_of(len(frames), options)
        state = self._state(original[keys], frames[keys], pool)
        if len(state.dirty) <= options.share * len(keys):
            return None
        self._push(state)
        if is_stuck(state, options=self.options.lend):
            return None
        self._mend(state)
        state.given_up = frozenset(state.dirty)
        self._bring_back(state, stuck=False, lifted=False, agreement=options.agreement)
        solved = eased(state, options=self.options.ease)
        return between_keys(original, frames, keys, solved)

    def _pushed_from(self, state: WindowState, poses: FloatArray) -> bool:
        """Push frames on from poses (T, V, 3); return whether few enough are left."""
        before = state.snapshot()
        state.place(poses)
        push_frames(state, options=self.options.keys.push)
        if kept := not is_stuck(state, options=self.options.lend):
            return kept
        state.restore(before)
        return False

    def _push(self, state: WindowState) -> None:
        """Push all frames together, or solve those of attached parts each for itself."""
        options = self.options
        if self.surface.ties is not None:
            kernel = gaussian_kernel(state.frames, options.attached.width)
            state.solve_alone(kernel, options.attached.step, work=options.attached.work)
            return
        # What pushing leaves of several bodies tells whether there is another way altogether.
        single = self.surface.clusters == 1
        push_frames(state, lend=options.lend if single else None, options=options.push)

    def _mend(self, state: WindowState) -> bool:
        """Solve frames from their neighbours or mend them; whether each was solved for itself."""
        options = self.options
        if is_stuck(state, options=options.lend):
            lend_frames(state, options=options.lend)
            return True
        if lend_nearer(state, options=options.lend):
            return True
        if self.surface.ties is None:
            mend_frames(state, effort=self.effort, options=options.mend)
        return False

    def _bring_back(
        self,
        state: WindowState,
        *,
        stuck: bool,
        lifted: bool,
        tight: bool = False,
        agreement: tuple[float, ...] | None = None,
    ) -> None:
        """Take back what the frames do not need.

        stuck: each was solved for itself; tight: they were led by what was brought back already;
        agreement: of the relaxing, another than usual.
        """
        options, alone = self.options, stuck or self.surface.ties is not None
        relax = options.relax
        if agreement is not None:
            relax = replace(relax, agreement=agreement)
        if not (alone or lifted or tight):
            tighten_frames(state, self.tighten, options=options.tighten)
        shift_frames_back(state, options=options.settle)
        settle_frames(state, options=options.settle)
        relax_frames(state, alone=stuck, lifted=lifted, options=relax)
        # Frames that were solved each for itself stand out where they take another way: no less so
        # after as much work again.
        if not alone:
            steady_frames(state, options=options.steady)
        cure_frames(state, options=options.relax)
        if not stuck:
            restore_shapes(state, options=options.restore)


def eased(state: WindowState, *, options: EaseOptions = EaseOptions()) -> FloatArray:
    """Return poses without the faintest displacements, except around what that would close.

    What is far from all contacts keeps every bit; displacements fade in over the surface and time.
    """
    moved = state.poses - state.original
    length = np.linalg.norm(moved, axis=2)
    for body in state.surface.rigid.slices:
        length[:, body] = length[:, body].max(axis=1, keepdims=True)
    kept = np.clip(length / options.still - 1.0, 0.0, 1.0)
    changed = np.flatnonzero((kept < np.minimum(length, 1.0)).any(axis=1)).tolist()
    for rings in (*options.rings, None):
        weight = kept[:, :, None]
        result = np.where(weight > 0, state.original + weight * moved, state.original)
        result = np.where(weight < 1, result, state.poses)
        pairs_of = dict(zip(changed, state.pairs_of(result, changed), strict=True))
        changed = [f for f, pairs in pairs_of.items() if len(pairs) > len(state.pairs[f])]
        if not changed or rings is None:
            break
        for frame in changed:
            closed = state.surface.vertices_of(pairs_of[frame])
            away = state.surface.rings_from(closed, 2 * rings) / rings - 1.0
            kept[frame] = np.where(length[frame] > 0, np.maximum(kept[frame], 1.0 - away), 0.0)
            kept[frame] = np.minimum(kept[frame], 1.0)
            for body in state.surface.rigid.slices:
                kept[frame, body] = kept[frame, body].max()
    result[changed] = state.poses[changed]
    return result
