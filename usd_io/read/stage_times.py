"""The frames of a selection of meshes: samples, and the whole frames between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from usd_io.errors import FrameSpecError
from usd_io.frame_grid import MOST_ADDED_FRAMES, FrameGrid, frame_grid
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.transforms import transform_times
from usd_io.times import FrameSpec

Times = NDArray[np.float64]
# So many keys on neighbouring frames may be poses that were laid out one after the other.
FEW_KEYS = 8
# So many whole frames without a sample for each that has one look like animation on threes.
MOST_LACKING = 2


@dataclass(frozen=True)
class StageTimes:
    """The time codes of several meshes; [nan] where nothing of them is animated.

    Attributes:
        keys: that say how the meshes move; between them points are linear in time (K,).
        every: all that can be looked at (N,).
        chosen: those of `every` that were asked for (T,).
        warnings: one line each.
    """

    keys: Times
    every: Times
    chosen: Times
    warnings: tuple[str, ...] = ()

    def beside(self, times: Iterable[float]) -> set[float]:
        """Return the members of `every` just before and just after each of some members."""
        rows = np.searchsorted(self.every, np.array(sorted(times), dtype=np.float64))
        near = np.concatenate([rows - 1, rows + 1])
        return set(self.every[near[(near >= 0) & (near < len(self.every))]].tolist())


def stage_times(
    meshes: Sequence[AnimatedMesh],
    spec: FrameSpec | None = None,
    *,
    whole: bool = True,
    authored: bool = False,
) -> StageTimes:
    """Return the time codes of meshes of one stage.

    Transforms count where there are several meshes, which move against each other then.

    Args:
        meshes: of one stage.
        spec: which of the frames to choose; None: all.
        whole: whether all whole frames between the first and the last key count, too, and what
            `spec` names between them: see `FrameRange.exact`.
        authored: only authored samples count; of a skin the samples of its joints and the like.

    Raises:
        FrameSpecError: no frame is chosen.
    """
    keys = _together(meshes, [mesh.times for mesh in meshes])
    every, warnings = keys, list[str]()
    if authored:
        every = _together(meshes, [mesh.samples for mesh in meshes])
    elif whole and not np.isnan(keys).any():
        every, warnings = _filled(keys, spec, frame_grid(meshes[0].stage))
        if spec is not None:
            every = np.union1d(every, spec.missing_from(every, most=MOST_ADDED_FRAMES))
    chosen = every if spec is None else every[spec.select(every, require=True)]
    if spec is not None:
        warnings += _left_out(spec, every, "without a sample")
    if spec is None and (told := _out_of_range(meshes[0].stage, every)):
        warnings.append(told)
    return StageTimes(keys, every, chosen, tuple(warnings))


def key_times(meshes: Sequence[AnimatedMesh], spec: FrameSpec | None = None) -> StageTimes:
    """Return the time codes of the key poses of meshes of one stage.

    They are authored samples, of a skin those of its joints and the like; whole frames of a skin
    are keys as well where `spec` names them one by one. Where every whole frame has a sample, as
    baked animation has, nothing tells keys from other frames: then `every` has none between those
    that `spec` names one by one. Raises FrameSpecError where no key is chosen.
    """
    frames = _together(meshes, [mesh.times for mesh in meshes])
    every = _together(meshes, [mesh.samples for mesh in meshes])
    baked = _on_every_frame(every, frame_grid(meshes[0].stage))
    warnings = list[str]()
    if spec is None:
        if baked and len(every) > FEW_KEYS:
            warnings.append(_told_baked(every))
        if told := _out_of_range(meshes[0].stage, every):
            warnings.append(told)
        return StageTimes(frames, every, every, tuple(warnings))
    if (named := spec.one_by_one) is not None:
        every = np.union1d(every, frames[named.select(frames)]) if len(frames) > 1 else every
    try:
        chosen = every[spec.select(every, require=True)]
    except FrameSpecError as error:
        cure = (
            "; these are the keys: name other frames one by one, such as 3,5, to make keys of them"
        )
        raise FrameSpecError(f"{error}{cure if len(frames) > len(every) else ''}") from error
    if baked and named is not None:
        outside = (every <= chosen[0]) | (every >= chosen[-1])
        every = every[outside | np.isin(every, chosen)]
    warnings += _left_out(spec, every, "no key")
    if len(chosen) > 1 and np.diff(np.searchsorted(every, chosen)).min() > 1:
        warnings.append(_told_apart(spec, every, frame_grid(meshes[0].stage)))
    return StageTimes(frames, every, chosen, tuple(warnings))


def _left_out(spec: FrameSpec, every: Times, what: str) -> list[str]:
    """Return lines on frames that are named, and are not among all (N,), but `what`."""
    return [told for told in (spec.left_out(every, what), spec.beyond(every)) if told]


def _on_every_frame(samples: Times, grid: FrameGrid) -> bool:
    """Return whether each whole frame from the first to the last sample (N,) has one."""
    filled = None if np.isnan(samples).any() else grid.filled(samples)
    return len(samples) > 1 and filled is not None and len(filled) == len(samples)


def _told_baked(every: Times) -> str:
    """Return a line on keys (N,) on every frame."""
    return (
        f"every whole frame from {every[0]:.10g} to {every[-1]:.10g} has a sample, as in baked "
        "animation, and so each is taken as a key; name the key poses, such as --frames "
        f"{every[0]:.10g},{every[len(every) // 2]:.10g},{every[-1]:.10g}, to take all others as "
        "in-betweens, or repair all frames as a clip"
    )


def _told_apart(spec: FrameSpec, every: Times, grid: FrameGrid) -> str:
    """Return a line on frames that are named, of which no two are neighbouring keys (N,)."""
    told = (
        f"frames {spec.text!r}: no two neighbouring keys are named, so no in-between is looked "
        f"at; name neighbours, such as --frames {every[0]:.10g}:{every[-1]:.10g}"
    )
    filled = grid.filled(every)
    lacking = np.zeros(0) if filled is None else np.setdiff1d(filled, every)
    # On twos or threes, or baked but for a few frames: else the samples are meant as keys.
    if not 0 < len(lacking) <= MOST_LACKING * len(every):
        return told
    return (
        f"{told}, or give each whole frame a sample, as baked animation has (so far "
        f"{lacking[0]:.10g} {'has' if len(lacking) == 1 else 'and others have'} none): then the "
        "frames that are named are the keys"
    )


def _out_of_range(stage: Usd.Stage, times: Times) -> str:
    """Return a line on times (N,) that lie outside the time range of a stage; "" for none."""
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    known = times[~np.isnan(times)]
    if not stage.HasAuthoredTimeCodeRange() or not start <= end:
        return ""
    beyond = int(np.count_nonzero((known < start) | (known > end)))
    if not 0 < beyond < len(known):
        return ""
    return (
        f"{beyond} of {len(known)} frames lie outside the time range of the stage, {start:.10g} to "
        f"{end:.10g}, as handles do, and count like all others: --frames {start:.10g}:{end:.10g} "
        "leaves them out"
    )


def _together(meshes: Sequence[AnimatedMesh], times: list[Times]) -> Times:
    """Return the union of times of meshes, and of their transforms where there are several."""
    if len(meshes) > 1:
        times = times + [transform_times(mesh) for mesh in meshes]
    union = np.unique(np.concatenate([np.zeros(0), *times]))
    known = union[~np.isnan(union)]
    return known if len(known) else union[:1]


def _filled(keys: Times, spec: FrameSpec | None, grid: FrameGrid) -> tuple[Times, list[str]]:
    """Return keys and whole frames; where these are too many, those that the user names."""
    filled = grid.filled(keys)
    if filled is not None:
        return filled, []
    named = None if spec is None else spec.between(keys[0], keys[-1], most=MOST_ADDED_FRAMES)
    if named is not None:
        # What is changed at a frame is held at the frames beside it.
        near = np.concatenate([keys, named, named - grid.step, named + grid.step])
        return np.unique(near[(near >= keys[0]) & (near <= keys[-1])]), []
    return keys, [
        f"keys lie from {keys[0]:.10g} to {keys[-1]:.10g}: more than {MOST_ADDED_FRAMES} whole "
        f"frames have none, so that only the {len(keys)} keys are looked at; mend the key that is "
        "far off, or name frames with --frames"
    ]
