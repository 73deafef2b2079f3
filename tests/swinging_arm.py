"""A stage whose keys are clean and whose in-betweens are not: an arm swings through a body."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.meshes import Mesh, swept

# The arm hangs so far in front of the body, or behind it, and so far to its side.
REACH, SIDE = 0.6, 0.15


def arm_mesh(swing: float) -> Mesh:
    """One closed tube: a thick body upright, over a shoulder a thin arm that hangs down again.

    swing: 1 hangs in front of the body, -1 behind it, 0 passes through it.
    """
    body = [(0.0, 0.0, z) for z in np.linspace(0.0, 1.6, 16)]
    turn = np.linspace(0.0, np.pi, 16)[1:-1]
    reach, side = 0.5 * REACH * swing, 0.5 * SIDE
    over = [(side * (1 - np.cos(a)), reach * (1 - np.cos(a)), 1.6 + 0.35 * np.sin(a)) for a in turn]
    arm = [(SIDE, REACH * swing, z) for z in np.linspace(1.6, 0.7, 11)]
    radii = np.r_[np.full(16, 0.2), np.linspace(0.18, 0.1, 14), np.full(11, 0.09)]
    return swept(np.array([*body, *over, *arm]), radii, 9, closed=False)


def arm_pose(swing: float) -> NDArray[np.float64]:
    """Points (V, 3) of the arm."""
    return arm_mesh(swing)[0]


def arm_stage(
    path: Path,
    swings: Sequence[float] = (1.0, -1.0),
    *,
    times: Sequence[float] | None = None,
) -> Path:
    """A stage with the arm as /Root/Arm, keys ten time codes apart from 1 on."""
    from usd_io import AuthoredMesh, write_animation

    mesh = AuthoredMesh(
        path="/Root/Arm",
        faces=arm_mesh(1.0)[1],
        points=[arm_pose(swing) for swing in swings],
        rest=arm_pose(1.0),
    )
    codes = 1.0 + 10.0 * np.arange(len(swings)) if times is None else np.asarray(times)
    write_animation(path, mesh, times=codes)
    return path
