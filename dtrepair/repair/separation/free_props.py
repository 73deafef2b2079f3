"""Which props are free: they go round nothing, and nothing holds them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, partial

import numpy as np

from dtrepair.numerics.worn.measure import WornOptions
from dtrepair.repair.scene.attached_parts import attached_bodies
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.separation.penetration import BodyShape
from dtrepair.repair.separation.worn_pairs import WornPairs, covered_bodies


def with_free_props(scene: Scene, *, options: WornOptions) -> Scene:
    """Return a scene in which only those bodies are props that may be rigid.

    What goes round something, or lies over it as cloth does, gives way to it; what is attached to
    another body goes where that leads it. The published method knows no props. options: from when
    on a body is worn.
    """
    called = [k for k, body in enumerate(scene.bodies) if body.prop]
    if not called:
        return scene
    solid = np.diff(scene.triangle_starts) > 0
    free = {k for k in called if solid[k] and scene.options.method == "full"}
    if free:
        over = covered_bodies(scene) & ~np.eye(len(scene.bodies), dtype=bool)
        free -= set(np.flatnonzero(over.any(axis=1)).tolist())
        free -= attached_bodies(scene.attachments, scene.body_of, scene.body_of_vertex)
        worn = WornPairs(scene, cache(partial(BodyShape, scene)), options)
        free = {k for k in free if not worn.goes_round(k)}
    bodies = tuple(replace(body, prop=k in free) for k, body in enumerate(scene.bodies))
    return scene.changed(bodies=bodies)
