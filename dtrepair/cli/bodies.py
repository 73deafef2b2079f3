"""The meshes of an input as the bodies of a repair: rest, pins, colliders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dtrepair.cli.failures import USAGE, Failure
from dtrepair.cli.rest import Rest
from dtrepair.cli.sources import Source, StageSource

if TYPE_CHECKING:
    from dtrepair.repair.repairer import Body

Pins = list[NDArray[np.float64] | None]


def read_pins(source: Source, name: str | None) -> Pins:
    """Return weights (V,) from 0 free to 1 fixed for each mesh that has a primvar or subset `name`.

    Without a name no mesh has pins. It is a usage error if no mesh has anything of that name.
    """
    if name is None:
        return [None] * len(source.meshes)
    if not isinstance(source, StageSource):
        raise Failure(f"--pin {name}: only for USD stages; leave it out", USAGE)
    from usd_io.vertex_weights import read_vertex_weights

    pins = [read_vertex_weights(mesh.handle, name) for mesh in source.meshes]
    if all(weights is None for weights in pins):
        raise Failure(
            f"--pin {name}: no selected mesh has a primvar or GeomSubset of that name; "
            "check the name",
            USAGE,
        )
    return pins


def make_bodies(source: Source, rests: list[Rest], pins: Pins) -> list[Body]:
    """Return the bodies in the space of the frames: local for one mesh, else world."""
    from dtrepair.repair.repairer import Body

    time = float(source.times[0])
    several = len(source.meshes) > 1
    bodies = []
    for mesh, rest, pin in zip(source.meshes, rests, pins, strict=True):
        points = source.to_world(mesh, time, rest.points) if several else rest.points
        mobility = 0.0 if mesh.collider else 1.0
        bodies.append(Body(points, mesh.faces, mobility=mobility, pin=pin))
    return bodies
