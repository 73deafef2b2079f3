"""The meshes of an input as the bodies of a repair: rest, pins, directions, colliders, units."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dtrepair.cli.failures import USAGE, Failure
from dtrepair.cli.rest import Rest
from dtrepair.cli.sources import Source, StageSource

if TYPE_CHECKING:
    from dtrepair.repair.bodies import Body
    from dtrepair.repair.options import RepairOptions
    from usd_io import AnimatedMesh

PerMesh = list[NDArray[np.float64] | None]


@dataclass(frozen=True)
class Controls:
    """For each mesh: weights (V,) from 0 free to 1 fixed, world directions (V, 3), or None."""

    pins: PerMesh
    directions: PerMesh


def read_controls(source: Source, pin: str | None, direction: str | None) -> Controls:
    """Read what --pin and --direction name.

    It is a usage error if no mesh has anything of a name.
    """
    nothing: PerMesh = [None] * len(source.meshes)
    pins = nothing if pin is None else read_pins(source, pin)
    directions = nothing if direction is None else _read_directions(source, direction)
    return Controls(pins, directions)


def read_pins(source: Source, name: str) -> PerMesh:
    """Return weights (V,) of each mesh that has a primvar or GeomSubset `name`, else None.

    It is a usage error if no mesh has anything of that name.
    """
    from usd_io.vertex_weights import read_vertex_weights

    handles = _handles(source, f"--pin {name}")
    pins = [read_vertex_weights(handle, name) for handle in handles]
    return _found(pins, f"--pin {name}", "primvar or GeomSubset")


def _read_directions(source: Source, text: str) -> PerMesh:
    """A vector primvar, or SUBSET=x,y,z: the vector where the subset's weight is above 0."""
    from usd_io.vertex_weights import read_vertex_directions, read_vertex_weights

    handles = _handles(source, f"--direction {text}")
    name, sign, numbers = text.partition("=")
    if not sign:
        vectors = [read_vertex_directions(handle, name) for handle in handles]
        return _found(vectors, f"--direction {text}", "vector primvar")
    try:
        vector = np.array([float(number) for number in numbers.split(",")])
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise Failure(f"--direction {text}: expected SUBSET=x,y,z, such as hand=0,1,0", USAGE)
    weights = [read_vertex_weights(handle, name) for handle in handles]
    chosen = _found(weights, f"--direction {text}", "primvar or GeomSubset")
    return [None if part is None else (part > 0)[:, None] * vector for part in chosen]


def _handles(source: Source, option: str) -> list[AnimatedMesh]:
    if not isinstance(source, StageSource):
        raise Failure(f"{option}: only for USD stages; leave it out", USAGE)
    return [mesh.handle for mesh in source.meshes]


def _found(values: PerMesh, option: str, what: str) -> PerMesh:
    if all(value is None for value in values):
        raise Failure(
            f"{option}: no selected mesh has a {what} of that name; check the name", USAGE
        )
    return values


def make_bodies(source: Source, rests: list[Rest], controls: Controls) -> list[Body]:
    """Return the bodies in the space of the frames: local for one mesh, else world."""
    from dtrepair.repair.bodies import Body

    several = len(source.meshes) > 1
    time = float(source.times[0])
    bodies = []
    for index, (mesh, rest) in enumerate(zip(source.meshes, rests, strict=True)):
        points = source.to_world(mesh, time, rest.points) if several else rest.points
        direction = controls.directions[index]
        if direction is not None and not several:
            origin = source.to_world(mesh, time, np.zeros_like(direction))
            direction = source.to_local(mesh, time, origin + direction)
        bodies.append(
            Body(
                points,
                mesh.faces,
                mobility=0.0 if mesh.collider else 1.0,
                pin=controls.pins[index],
                direction=direction,
            )
        )
    return bodies


def in_units_of_frames(source: Source, options: RepairOptions) -> RepairOptions:
    """Return the options with lengths in the space of the frames instead of stage units.

    One mesh is repaired in its local space, whose units a transform may stretch: the result keeps
    at least the clearance and stays within the largest displacement.
    """
    if len(source.meshes) > 1 or not isinstance(source, StageSource):
        return options
    mesh, time = source.meshes[0], float(source.times[0])
    corners = source.to_world(mesh, time, np.concatenate([np.zeros((1, 3)), np.eye(3)]))
    stretch = np.linalg.svd(corners[1:] - corners[0], compute_uv=False)
    limit = options.maximum_displacement
    return replace(
        options,
        clearance=options.clearance / float(stretch.min()) if options.clearance else 0.0,
        maximum_displacement=None if limit is None else limit / float(stretch.max()),
    )
