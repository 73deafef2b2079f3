"""Velocities and accelerations of written points, by finite differences."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from usd_io.values import create_attribute, vec3f_array
from usd_io.write.atomic_layer import AtomicLayer


def author_rates(
    file: AtomicLayer,
    prim_path: Sdf.Path,
    names: Sequence[str],
    times: Mapping[float, bool],
    time_codes_per_second: float,
    *,
    original: Callable[[str, float], Any],
) -> None:
    """Author velocities and accelerations (per second) at every time of the points.

    Args:
        file: the layer, with all points in place.
        prim_path: the mesh.
        names: which of velocities and accelerations to author.
        times: all time codes of the points, True where they were changed.
        time_codes_per_second: of the stage.
        original: the input's value of a name at a time, for frames that are unchanged like their
            neighbours.

    Where nothing can be computed (one sample, blocked or uneven neighbours) the value is blocked.
    """
    assert file.layer is not None
    codes = sorted(times)
    for name in names:
        path = create_attribute(file.layer, prim_path, name)
        if not codes:
            file.layer.GetAttributeAtPath(path).default = Sdf.ValueBlock()
            continue
        for row, time in enumerate(codes):
            near = codes[max(row - 1, 0) : row + 2]
            value = None
            if any(times[code] for code in near):
                value = _difference(file.layer, prim_path, name, time, near)
                if value is not None:
                    value = value * time_codes_per_second ** (1 if name == "velocities" else 2)
            else:
                value = original(name, time)
            if value is None or isinstance(value, Sdf.ValueBlock):
                file.set_sample(path, time, Sdf.ValueBlock())
            else:
                file.set_sample(path, time, vec3f_array(value))
            file.end_frame()


def _difference(
    layer: Sdf.Layer, prim_path: Sdf.Path, name: str, time: float, near: Sequence[float]
) -> NDArray[np.float64] | None:
    """Return the first or second derivative (V, 3) per time code at `time`, one of two or three."""
    path = prim_path.AppendProperty("points")
    values = [layer.QueryTimeSample(path, code) for code in near]
    frames = [
        np.asarray(value, dtype=np.float64)
        for value in values
        if value is not None and not isinstance(value, Sdf.ValueBlock)
    ]
    if len(frames) != len(near) or len({frame.shape for frame in frames}) > 1 or len(near) < 2:
        return None
    steps = np.diff(near)
    slopes = [(frames[i + 1] - frames[i]) / step for i, step in enumerate(steps)]
    if len(slopes) == 1:
        return slopes[0] if name == "velocities" else None
    if name == "velocities":
        # Weighted central difference: exact for a parabola through the three points.
        velocities: NDArray[np.float64] = slopes[0] * steps[1] + slopes[1] * steps[0]
        return velocities / float(steps.sum())
    accelerations: NDArray[np.float64] = 2.0 * (slopes[1] - slopes[0]) / steps.sum()
    return accelerations
