"""A pose of a scene that still has a few pairs: mended from where it is, by small motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.full.mend import MendOptions, mend
from dtrepair.repair.scene.bounds import Judged, PairsOf, strain_of
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.surface.rigid_bodies import allowed
from dtrepair.repair.surface.surface import Surface

# Solves a pose (V, 3) of a surface from the input.
Alone = Callable[[Surface, FloatArray], FloatArray]


def mended(
    scene: Scene,
    mesh: WeldedMesh,
    before: FloatArray,
    judged: Judged,
    pairs: IntArray,
    pairs_of: PairsOf,
    *,
    step: float,
    options: MendOptions,
    farthest: float = np.inf,
    alone: Alone | None = None,
) -> tuple[Judged, IntArray]:
    """Return a pose with `pairs` (K, 2) mended, or solved `alone`, if it gets fewer; its pairs.

    Of what keeps only a share of the correction, nothing is taken that is solved alone, which is
    all of the correction, or moves farther than `farthest`. Where nothing is solved alone, a pose
    that is not strained does not get so, and one with many pairs, for which small motions do not
    do, is left as it is. step: largest motion in an iteration; both in units of the surface's size.
    """
    last = None if judged.lowered else alone
    if last is None and len(pairs) > options.mendable:
        return judged, pairs
    unit, start = mesh.reduced(before), mesh.reduced(judged.points)
    # The last resort is the same for both, and long.
    for numbers, resort in ((options, last), (facing(options), None)):
        near = mend(mesh.surface, unit, [start], step=step, alone=resort, options=numbers)
        near = allowed(mesh.surface.rigid, unit, near, mesh.farthest)
        points = mesh.expanded(before, unit, near)
        found = pairs_of(points)
        if len(found) < len(pairs) or not mesh.surface.sheets.any():
            break
    taken = len(found) < len(pairs)
    if judged.lowered:
        taken &= float(np.abs(near - start).max()) <= farthest
    if taken and last is None and strain_of(scene, before, points, loosely=True):
        taken = bool(strain_of(scene, before, judged.points, loosely=True))
    return (judged._replace(points=points), found) if taken else (judged, pairs)


def facing(options: MendOptions) -> MendOptions:
    """Return the options with sheets that face what they meet, see `DirectionOptions`."""
    direction = replace(options.push.direction, facing=True)
    return replace(options, push=replace(options.push, direction=direction))
