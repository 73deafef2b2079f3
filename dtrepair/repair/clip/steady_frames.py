"""Frames that stand out from their neighbours, moved to where these ask them to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.temporal import apply_in_time, second_differences, steady_weights
from dtrepair.repair.clip.window_state import WindowState


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
