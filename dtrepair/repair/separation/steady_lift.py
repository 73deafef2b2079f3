"""The lift of one layer in all frames of a window, smooth in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, extents, lengths
from dtrepair.numerics.temporal import gaussian_kernel, undamped
from dtrepair.repair.separation.layer_lift import LayerLift, Sunken


def lifted_steadily(
    lift: LayerLift, poses: FloatArray, frames: FloatArray, meets: NDArray[np.bool_]
) -> FloatArray:
    """Return poses (T, V, 3) at `frames` (T,) with a layer lifted, smoothly in time.

    meets: in which frames (T,) it meets what it lies over; before the first of them and after the
    last nothing of it is taken to be under that.
    """
    options = lift.options
    through = np.logical_or.accumulate(meets) & np.logical_or.accumulate(meets[::-1])[::-1]
    shifts = np.zeros((len(poses), len(lift.own), 3))
    wide, shifts[through] = _first_lifts(lift, poses[through])
    before, last = np.inf, 0.0
    for index, width in enumerate(options.widths if len(frames) > 1 else (0.0,)):
        if index:
            shifts = np.zeros_like(shifts)
            shifts[through] = [lift(pose, wide) for pose in poses[through]]
        longest = float(lengths(shifts.reshape(-1, 3)).max())
        if longest == 0.0 or (width < last and longest > options.less * before):
            break
        before, last = longest, width
        shifts = undamped(gaussian_kernel(frames, width), shifts)
        poses = np.stack([lift.moved(*both) for both in zip(poses, shifts, strict=True)])
    return poses


def _first_lifts(lift: LayerLift, poses: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return which vertices (n,) are lifted, and displacements (T, n, 3) of poses (T, V, 3).

    These are in regions wide enough, see `_wide`, that a lift leads back.
    """
    sunken = [lift.sunken(lift.inner(pose)) for pose in poses]
    wide = np.zeros(len(lift.own), dtype=bool)
    for pose, found in zip(poses, sunken, strict=True):
        wide |= _wide(lift, pose, found)
    if not wide.any():
        return wide, np.zeros((len(poses), len(wide), 3))
    both = list(zip(poses, sunken, strict=True))
    shifts = np.stack([lift(pose, wide, found) for pose, found in both])
    led = wide & _led_back(lift, poses, sunken, shifts, wide)
    if not np.array_equal(led, wide):
        shifts = np.stack([lift(pose, led, found) for pose, found in both])
    return led, shifts


def _wide(lift: LayerLift, pose: FloatArray, sunken: Sunken) -> NDArray[np.bool_]:
    """Return which vertices (n,) of a pose (V, 3) are in regions as wide as their way back.

    What came through a layer did so over its own width. A few vertices of a crease whose normals
    are turned would be led to the far side of a limb: of an armpit over the shoulder.
    """
    wide = sunken.under.copy()
    vertices, region = lift.regions(wide)
    width = extents(pose[lift.own][vertices], region)
    longest = np.zeros(len(width))
    np.maximum.at(longest, region, lengths(sunken.needed[vertices]))
    wide[vertices] = (longest <= lift.options.wide * (width + lift.edge))[region]
    return wide


def _led_back(
    lift: LayerLift,
    poses: FloatArray,
    sunken: Sequence[Sunken],
    shifts: FloatArray,
    wide: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return which vertices (n,) of poses (T, V, 3) are in regions that a lift leads back.

    sunken: what went under in each pose; shifts: the lifts (T, n, 3) of what is wide (n,).
    """
    ways, led = np.zeros((2, len(lift.own))), np.zeros(len(lift.own), dtype=bool)
    for pose, found, shift in zip(poses, sunken, shifts, strict=True):
        among = lift.among(found.under, wide)
        ways[0, among] += lengths(found.needed[among])
        under, needed = lift.sunken(lift.inner(lift.moved(pose, shift)))
        under &= ~(found.under & ~among)  # what no lift touches
        ways[1, under] += lengths(needed[under])
    vertices, region = lift.regions(ways.sum(axis=0) > 0.0)
    before, after = (np.bincount(region, way[vertices]) for way in ways)
    led[vertices] = (after <= lift.options.left * before)[region]
    return led
