"""Frames in runs, the keys of their shapes, and offsets of the vertices that move."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

# Part of the tolerance that leaving out small offsets may cost, so that few vertices move.
STILL = 0.1


def runs(frames: Iterable[int]) -> list[list[int]]:
    """Return frames in order as runs of consecutive ones."""
    found: list[list[int]] = []
    for frame in sorted(set(frames)):
        if found and frame == found[-1][-1] + 1:
            found[-1].append(frame)
        else:
            found.append([frame])
    return found


def run_name(run: list[int]) -> str:
    """Name of a run, such as "12" or "12-20"."""
    return str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}"


def parse_frames(text: str) -> list[int]:
    """Return the frames of "7", "1:20", "1:20x5" or several of them with commas, in order.

    Raises ValueError that says what was expected.
    """
    frames: set[int] = set()
    for part in text.split(","):
        span, _, step = part.strip().partition("x")
        first, colon, last = span.partition(":")
        try:
            numbers = int(first), int(last) if colon else int(first), int(step) if step else 1
        except ValueError:
            numbers = (0, -1, 1)
        if numbers[0] > numbers[1] or numbers[2] < 1:
            raise ValueError(f"frames: expected such as 7, 1:20 or 1:20x5, got {part.strip()!r}")
        frames.update(range(numbers[0], numbers[1] + 1, numbers[2]))
    return sorted(frames)


def weight_keys(frames: list[int], weights: NDArray[np.floating]) -> list[tuple[int, float]]:
    """Return (frame, weight) keys of a shape: its weights in a run, and 0 beside the run.

    Keys that a line between their neighbours passes through are left out.
    """
    inside = [(f, float(w)) for f, w in zip(frames, weights, strict=True)]
    keys = [(frames[0] - 1, 0.0), *inside, (frames[-1] + 1, 0.0)]
    kept = [keys[0]]
    for place in range(1, len(keys) - 1):
        (_, before), (_, here), (_, after) = keys[place - 1 : place + 2]
        if not before == here == after:
            kept.append(keys[place])
    return [*kept, keys[-1]]


def moved(before: NDArray[np.floating], after: NDArray[np.floating]) -> NDArray[np.intp]:
    """Return the vertices (M,) that move in any of the frames (T, V, 3): whose bits differ."""
    return np.flatnonzero((np.asarray(before) != np.asarray(after)).any(axis=(0, 2)))


def few_shapes(
    offsets: NDArray[np.floating], tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return shapes (K, V, 3) and weights (T, K) that add up to offsets (T, V, 3).

    The truncated singular value decomposition (Eckart and Young 1936) of least rank that leaves no
    vertex farther off than the tolerance; the largest weight of a shape is 1. With a tolerance of
    0, or where nothing is saved, each frame has its own shape.
    """
    frames = len(offsets)
    flat = np.asarray(offsets, dtype=np.float64).reshape(frames, -1)
    if tolerance > 0.0:
        basis = np.linalg.eigh(flat @ flat.T)[1][:, ::-1]
        for rank in range(1, frames):
            weights, shapes = basis[:, :rank], basis[:, :rank].T @ flat
            left = (flat - weights @ shapes).reshape(frames, -1, 3)
            if np.linalg.norm(left, axis=2).max() <= (1.0 - STILL) * tolerance:
                largest = weights[np.abs(weights).argmax(axis=0), np.arange(rank)]
                found = (shapes * largest[:, None]).reshape(rank, -1, 3)
                still = np.linalg.norm(found, axis=2) <= STILL * tolerance / rank
                return np.where(still[:, :, None], 0.0, found), weights / largest
    return flat.reshape(frames, -1, 3), np.eye(frames)
