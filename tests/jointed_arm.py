"""A stage of parts that overlap on purpose: a forearm that ends inside an upper arm, and bends."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.meshes import Mesh, joined, tube

FRAMES = 7
# An upper arm, and a forearm that ends inside it.
UPPER, FORE = tube(12, 24, 0.2, 2.0), tube(12, 24, 0.2, 2.0)


def arm(bend: float, reach: float = 1.8) -> NDArray[np.float64]:
    """Both parts; the forearm is turned about its end in the upper arm."""
    turn = np.array(
        [[np.cos(bend), 0.0, np.sin(bend)], [0.0, 1.0, 0.0], [-np.sin(bend), 0.0, np.cos(bend)]]
    )
    lower = (FORE[0] * (0.9, 0.9, 1.0) + (0.03, 0.01, 1.0)) @ turn.T + (0.0, 0.0, reach - 1.0)
    return np.concatenate([UPPER[0], lower])


def arm_mesh() -> Mesh:
    return joined(UPPER, FORE)


def arm_stage(path: Path, bends: NDArray[np.float64], *, rest: bool = True) -> Path:
    """A stage with both parts in one mesh that bends over time; without a rest pose if wanted."""
    from usd_io import AuthoredMesh, write_animation

    mesh = AuthoredMesh(
        path="/Root/Arm",
        faces=arm_mesh()[1],
        points=[arm(bend) for bend in bends],
        rest=arm(0.0) if rest else None,
    )
    write_animation(path, mesh, times=1.0 + np.arange(len(bends)))
    return path
