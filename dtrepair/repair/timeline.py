"""Time of an animation: smoothing kernels over uneven samples, cuts between shots."""

from __future__ import annotations

import numpy as np

from dtrepair.geometry import FloatArray

# A Gaussian in time ends at this many standard deviations: farther frames are not touched.
REACH = 3.0
# A jump this many times larger than the typical motion between frames is a cut ...
CUT_RATIO = 8.0
# ... unless it is below this root mean square motion in units of the mesh's size.
CUT_FLOOR = 0.05
# The typical motion is the median of this many motions before the jump.
CUT_MEMORY = 24


def frame_units(times: FloatArray) -> FloatArray:
    """Times (T,) in units of their median spacing, so that a width means frames."""
    if len(times) < 2:
        return np.zeros(len(times))
    return (times - times[0]) / float(np.median(np.diff(times)))


def gaussian_kernel(frames: FloatArray, width: float) -> FloatArray:
    """Matrix (T, T) that smooths a function of time with a Gaussian; rows sum to 1.

    frames: times (T,) in frame units; width: standard deviation in frames, 0 for the identity.
    """
    if width <= 0.0:
        return np.eye(len(frames))
    distance = np.abs(frames[:, None] - frames[None, :]) / width
    weights = np.where(distance <= REACH, np.exp(-0.5 * distance**2), 0.0)
    return weights / weights.sum(axis=1, keepdims=True)


def apply_in_time(kernel: FloatArray, field: FloatArray) -> FloatArray:
    """The kernel (T, T) applied to a field (T, ...) over frames."""
    return (kernel @ field.reshape(len(field), -1)).reshape(field.shape)


def undamped(kernel: FloatArray, field: FloatArray) -> FloatArray:
    """A field (T, V, 3) smoothed in time such that a lone frame keeps its full length."""
    length = np.linalg.norm(field, axis=2)
    smooth = kernel @ length
    floor = 1e-12 * max(float(length.max(initial=0.0)), 1e-30)
    scale = np.where(length > 0, length / np.maximum(smooth, floor), 0.0)
    return apply_in_time(kernel, field * scale[:, :, None])


def spread_in_time(frames: FloatArray, values: FloatArray, width: float) -> FloatArray:
    """Largest of the values (T, k) of all frames, each fading over time as a bell of `width`."""
    result = values.copy()
    for index, frame in enumerate(frames):
        distance = np.abs(frames - frame) / width
        for other in np.flatnonzero((distance <= REACH) & (distance > 0)):
            bell = np.float32(np.exp(-0.5 * distance[other] ** 2))
            np.maximum(result[index], bell * values[other], out=result[index])
    return result


class CutFinder:
    """Tells, pose by pose, where a new shot starts."""

    def __init__(self) -> None:
        self._last: FloatArray | None = None
        self._time = 0.0
        self._speeds: list[float] = []

    def __call__(self, time: float, points: FloatArray, size: float) -> bool:
        """Whether the pose (V, 3) at `time` starts a new shot; the first pose does.

        Motions are compared as speeds: uneven samples are no cuts.
        """
        last, self._last = self._last, points
        step, self._time = time - self._time, time
        if last is None:
            return True
        motion = float(np.sqrt(((points - last) ** 2).sum(axis=1).mean()))
        speed = motion / step if step > 0 else 0.0
        known, self._speeds = self._speeds, [*self._speeds, speed][-CUT_MEMORY:]
        typical = float(np.median(known)) if known else np.inf
        if motion > CUT_FLOOR * size and speed > CUT_RATIO * typical:
            self._speeds = []
            return True
        return False
