"""Time of an animation: smoothing kernels and differences over uneven samples."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, lengths

Floats = NDArray[np.floating]

# Products of matrices of at most so many multiplications stay in one thread of OpenBLAS.
SMALL_PRODUCT = 2**18

# Standard deviations at which a Gaussian in time ends: farther frames are not touched.
CUTOFF = 3.0


def frame_units(times: FloatArray) -> FloatArray:
    """Return times (T,) in units of their median spacing, so that a width means frames."""
    if len(times) < 2:
        return np.zeros(len(times))
    frames: FloatArray = (times - times[0]) / float(np.median(np.diff(times)))
    return frames


def gaussian_kernel(frames: FloatArray, width: float) -> FloatArray:
    """Return the matrix (T, T) that smooths a function of time with a Gaussian; rows sum to 1.

    frames: times (T,) in frame units; width: standard deviation in frames, 0 for the identity.
    """
    if width <= 0.0:
        return np.eye(len(frames))
    distance = np.abs(frames[:, None] - frames[None, :]) / width
    weights = np.where(distance <= CUTOFF, np.exp(-0.5 * distance**2), 0.0)
    normalized: FloatArray = weights / weights.sum(axis=1, keepdims=True)
    return normalized


def apply_in_time(kernel: Floats, field: Floats) -> Any:
    """Apply a kernel (T, S) to a field (S, ...) over frames; return (T, ...).

    In products too small for threads of the linear algebra library: those would be in the way of
    frames that are worked on side by side.
    """
    columns = field.reshape(len(field), int(np.prod(field.shape[1:])))
    result = np.empty((len(kernel), columns.shape[1]), dtype=columns.dtype)
    width = max(1, SMALL_PRODUCT // max(kernel.size, 1))
    for start in range(0, columns.shape[1], width):
        block = slice(start, start + width)
        np.matmul(kernel, columns[:, block], out=result[:, block])
    return result.reshape(len(kernel), *field.shape[1:])


def runs_of(chosen: NDArray[np.bool_], *, apart: int = 1) -> list[slice]:
    """Return the runs of frames that are chosen (T,); fewer others than `apart` divide none."""
    starts, stops = np.flatnonzero(np.diff(chosen, prepend=False, append=False)).reshape(-1, 2).T
    first = np.ones(len(starts), dtype=bool)
    first[1:] = starts[1:] - stops[:-1] >= apart
    both = zip(starts[first].tolist(), stops[np.roll(first, -1)].tolist(), strict=True)
    return [slice(start, stop) for start, stop in both]


def eased_in_time(needed: FloatArray, frames: FloatArray, width: float) -> FloatArray:
    """Return values (T, ...) >= 0 that are smooth in time and nowhere below `needed` (T, ...).

    They come and go within some frames. frames: times (T,) in frame units; width: in frames.
    """
    if len(frames) == 1:
        return needed
    distance = np.abs(frames[:, None] - frames[None, :]) / width
    spread = np.stack([needed[near].max(axis=0) for near in distance <= 2.0])
    eased: FloatArray = np.maximum(gaussian_kernel(frames, width) @ spread, needed)
    return eased


def undamped(kernel: FloatArray, field: FloatArray) -> FloatArray:
    """Smooth a field (T, V, 3) in time such that a lone frame keeps its full length."""
    x, y, z = np.moveaxis(field, 2, 0)
    length = np.sqrt(x * x + y * y + z * z)
    moved = length > 0
    frames, vertices = np.flatnonzero(moved.any(axis=1)), np.flatnonzero(moved.any(axis=0))
    result = np.zeros_like(field)
    if not len(frames):
        return result
    length = length[np.ix_(frames, vertices)]
    smooth = apply_in_time(kernel[np.ix_(frames, frames)], length)
    floor = 1e-12 * max(float(length.max()), 1e-30)
    scaled = field[np.ix_(frames, vertices)]
    scaled *= (length / np.maximum(smooth, floor))[:, :, None]
    result[:, vertices] = apply_in_time(kernel[:, frames], scaled)
    return result


def spread_in_time(
    frames: FloatArray, values: NDArray[np.float32], width: float
) -> NDArray[np.float32]:
    """Return the largest of the values (T, k) of all frames, each fading as a bell of `width`."""
    result = values.copy()
    for index, frame in enumerate(frames):
        distance = np.abs(frames - frame) / width
        for other in np.flatnonzero((distance <= CUTOFF) & (distance > 0)):
            bell = np.float32(np.exp(-0.5 * distance[other] ** 2))
            np.maximum(result[index], bell * values[other], out=result[index])
    return result


def second_differences(frames: FloatArray) -> FloatArray:
    """Return the matrix (T - 2, T) of accelerations of a function of time at inner samples.

    frames: times (T,) in frame units.
    """
    gaps = np.diff(frames)
    result = np.zeros((max(len(frames) - 2, 0), len(frames)))
    for index in range(len(result)):
        before, after = gaps[index], gaps[index + 1]
        scale = 2.0 / (before + after)
        row = scale / before, -scale * (1.0 / before + 1.0 / after), scale / after
        result[index, index : index + 3] = row
    return result


def steady_weights(frames: FloatArray) -> FloatArray:
    """Return the matrix (T, T), zero diagonal, that puts each value where it accelerates least.

    Minimises the sum of squared second differences over one value, the others held.
    """
    differences = second_differences(frames)
    normal = differences.T @ differences
    diagonal = np.diag(normal).copy()
    diagonal[diagonal == 0.0] = 1.0
    weights = -normal / diagonal[:, None]
    np.fill_diagonal(weights, 0.0)
    return weights


def easing_weights(
    frames: FloatArray, needless: NDArray[np.bool_], *, level: bool = False
) -> FloatArray:
    """Return the matrix (T, T), zero diagonal, of `steady_weights`, with ends that ease.

    A needless value (T,) at an end goes halfway back to nothing: to accelerate least it would go on
    as it came, and swing to the other side before a correction begins. level: others at an end go
    to the one beside them.
    """
    weights = steady_weights(frames)
    for end, beside in ((0, 1), (len(frames) - 1, len(frames) - 2)):
        if (needless[end] or level) and len(frames) > 1:
            weights[end] = 0.0
            weights[end, beside] = 0.5 if needless[end] else 1.0
    return weights


def standing_out(
    moved: Sequence[FloatArray], part_of: NDArray[np.integer], *, limb: int
) -> FloatArray:
    """Return how far (T,) the part that does most stands out of each frame; 0 at both ends.

    Root mean squares over parts of how much farther vertices moved than if they came and went
    evenly; of a part of more than `limb` vertices over so many of them, those that do most.

    moved: displacements (V, 3) of each frame; part_of: the part (V,) of each vertex, -1 for none.
    """
    parts, result = _parts(part_of), np.zeros(len(moved))
    for index in range(1, len(moved) - 1):
        left, middle, right = moved[index - 1 : index + 2]
        farther = lengths(middle - 0.5 * (left + right)) - 0.5 * lengths(right - left)
        result[index] = _most_moved(np.maximum(farther, 0.0), parts, limb)
    return result


def steps_between(
    moved: Sequence[FloatArray], part_of: NDArray[np.integer], *, limb: int
) -> FloatArray:
    """Return how far (T - 1,) the part that does most goes between two frames.

    Root mean squares over parts, as in `standing_out`, where the arguments are told.
    """
    parts = _parts(part_of)
    steps = [lengths(after - before) for before, after in pairwise(moved)]
    return np.array([_most_moved(own, parts, limb) for own in steps])


def _parts(part_of: NDArray[np.integer]) -> list[NDArray[np.intp]]:
    """Return the vertices (N,) of each part."""
    sizes = np.bincount(part_of[part_of >= 0])
    return [np.flatnonzero(part_of == part) for part in np.flatnonzero(sizes)]


def _most_moved(away: FloatArray, parts: Sequence[NDArray[np.intp]], limb: int) -> float:
    """Return the root mean square of lengths (V,) over the part where it is largest.

    Of a part of more than `limb` vertices over so many of them, those that do most.
    """
    result, squares = 0.0, away**2
    for part in parts:
        own = squares[part]
        most = own if len(own) <= limb else np.partition(own, -limb)[-limb:]
        result = max(result, float(most.mean()))
    return float(np.sqrt(result))
