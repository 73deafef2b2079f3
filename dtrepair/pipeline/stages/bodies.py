"""The meshes of an input as the bodies of a repair: rest, pins, directions, colliders, units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.enclosure import turned_over
from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import ObjectOptions, ObjectSettings, PrimTable
from dtrepair.pipeline.stages.frames import stretches
from dtrepair.pipeline.stages.matching import CalledPairs, called_pairs, ignored_pairs
from dtrepair.pipeline.stages.object_settings import read_settings, rigid_without_effect
from dtrepair.pipeline.stages.rest import Rest
from dtrepair.pipeline.stages.shot.props import find_props
from dtrepair.pipeline.stages.shot.sets import find_sets, pairs_beside, pairs_of_sets
from dtrepair.pipeline.stages.sources import (
    Source,
    SourceMesh,
    StageSource,
    placing_time,
    usable_times,
)
from dtrepair.wording import counted, listed

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions
    from dtrepair.repair.scene.bodies import Body

# Frames of a clip that are tried as placements of the rest poses.
PLACEMENTS = 9

PerMesh = list[NDArray[np.float64] | None]


@dataclass(frozen=True)
class Controls:
    """For each mesh its settings, weights (V,) from 0 free to 1 fixed, world directions (V, 3).

    ignored: pairs of meshes (i, j), i <= j, whose contacts do not count.
    unmovable: those of them that do not for no other reason than that neither mesh may move, or
        that one keeps its shape, apart from the set around.
    told: pairs of meshes that the user calls attached or detached.
    layers: for each mesh how far out its triangles (F,) lie, None where nobody says.
    """

    settings: list[ObjectSettings]
    pins: PerMesh
    directions: PerMesh
    ignored: tuple[tuple[int, int], ...] = ()
    unmovable: tuple[tuple[int, int], ...] = ()
    told: CalledPairs = CalledPairs()
    layers: tuple[NDArray[np.int32] | None, ...] = ()
    warnings: tuple[str, ...] = ()


def read_controls(
    source: Source,
    objects: ObjectOptions,
    tables: Sequence[PrimTable] = (),
    *,
    sets: bool = True,
) -> Controls:
    """Read what the options, the tables and the primvars of the stage ask for.

    sets: what is of the set around, and not told how freely it moves, becomes a collider.
    It is a usage error if no mesh has anything of a name.
    """
    pin, direction = objects.pin, objects.direction
    found = read_settings(source, rigid=objects.rigid, layers=objects.layer, tables=tables)
    if sets:
        find_sets(source, found.each)
    find_props(source, found.each)
    nothing: PerMesh = [None] * len(source.meshes)
    pins = nothing.copy() if pin is None else read_pins(source, pin)
    directions = nothing if direction is None else _read_directions(source, direction)
    for index, (own, by) in enumerate(zip(found.each, found.origins, strict=True)):
        if own.pin is not None:
            option = f"{by['pin']}: pin {own.pin}"
            pins[index] = read_pins(source, own.pin, only=index, option=option)[0]
        if own.direction is not None:
            option = f"{by['direction']}: direction {own.direction}"
            (vectors,) = _read_directions(source, own.direction, only=index, option=option)
            directions[index] = vectors
    # What cannot move at all is not to be repaired: contacts of colliders among themselves.
    colliders = [index for index, mesh in enumerate(source.meshes) if mesh.collider]
    among = {(i, j) for i in colliders for j in colliders if i <= j}
    told = set(ignored_pairs(source, objects.ignore))
    # Nor what a thing that keeps its shape has with itself.
    if len(source.meshes) > 1:
        among |= {(index, index) for index, own in enumerate(found.each) if own.rigid}
    called, warnings = called_pairs(
        source, found.each, attach=objects.attach, detach=objects.detach
    )
    return Controls(
        found.each,
        pins,
        directions,
        tuple(sorted(told | among)),
        tuple(sorted(among - told - pairs_of_sets(source))),
        told=called,
        layers=tuple(read_layers(source, found.each)),
        warnings=(*found.warnings, *warnings, *rigid_without_effect(source, found)),
    )


def read_pins(source: Source, name: str, *, only: int | None = None, option: str = "") -> PerMesh:
    """Return weights (V,) of each mesh that has a primvar or GeomSubset `name`, else None.

    only: look at this mesh alone; option: who asks, for messages. It is a usage error if no mesh
    has anything of that name.
    """
    from usd_io.read.vertex_weights import read_vertex_weights

    meshes = _asked(source, option or f"--pin {name}", only)
    pins = [read_vertex_weights(mesh.handle, name) for mesh in meshes]
    return _found(pins, meshes, option or f"--pin {name}", "primvar or GeomSubset")


def _read_directions(
    source: Source, text: str, *, only: int | None = None, option: str = ""
) -> PerMesh:
    """A vector primvar, or SUBSET=x,y,z: the vector where the subset's weight is above 0."""
    from usd_io.read.vertex_weights import read_vertex_directions, read_vertex_weights

    option = option or f"--direction {text}"
    meshes = _asked(source, option, only)
    name, sign, numbers = text.partition("=")
    if not sign:
        vectors = [read_vertex_directions(mesh.handle, name) for mesh in meshes]
        return _found(vectors, meshes, option, "vector primvar")
    try:
        vector = np.array([float(number) for number in numbers.split(",")])
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector.any():
        raise UsageError(f"{option}: expected SUBSET=x,y,z, such as hand=0,1,0")
    weights = [read_vertex_weights(mesh.handle, name) for mesh in meshes]
    chosen = _found(weights, meshes, option, "primvar or GeomSubset")
    return [None if part is None else (part > 0)[:, None] * vector for part in chosen]


def read_layers(
    source: Source, each: Sequence[ObjectSettings]
) -> Iterator[NDArray[np.int32] | None]:
    """Yield of each mesh how far out its triangles (F,) lie; None where nobody says."""
    for mesh, own in zip(source.meshes, each, strict=True):
        if own.layer is None:
            yield None
        elif isinstance(own.layer, int):
            yield np.full(len(mesh.faces), own.layer, dtype=np.int32)
        else:
            from usd_io.read.face_numbers import read_face_numbers

            numbers = read_face_numbers(mesh.handle, own.layer)
            if numbers is None:
                raise UsageError(f"{mesh.path}: layer {own.layer}: has no primvar of that name")
            yield numbers


def _asked(source: Source, option: str, only: int | None) -> Sequence[SourceMesh]:
    if not isinstance(source, StageSource):
        raise UsageError(f"{option}: only for USD stages; leave it out")
    return source.meshes if only is None else source.meshes[only : only + 1]


def _found(values: PerMesh, meshes: Sequence[SourceMesh], option: str, what: str) -> PerMesh:
    if all(value is None for value in values):
        paths = listed([mesh.path for mesh in meshes])
        nobody = f"{paths} has no" if len(meshes) == 1 else f"none of {paths} has a"
        raise UsageError(
            f"{option}: {nobody} {what} of that name; check the name, or add it to the stage"
        )
    return values


class PlacedBodies(NamedTuple):
    """Bodies in one space, and the pairs (i, j), i < j, of them that meet wherever the rests lie.

    Only pairs whose contacts count, and of which no number of a layer tells which one is outside.
    """

    bodies: list[Body]
    met: list[tuple[int, int]]


def make_bodies(
    source: Source, rests: list[Rest], controls: Controls, *, mode: str = "both"
) -> PlacedBodies:
    """Return the bodies in the space of the frames: local for one mesh, else world."""
    from dtrepair.repair.scene.bodies import Body

    several = len(source.meshes) > 1
    time, met = placing_time(source, source.times), list[tuple[int, int]]()
    if several:
        time, met = _time_of_rest(source, rests)
        met = [pair for pair in met if mode != "self" and pair not in controls.ignored]
        met = [pair for pair in met if not _told_apart(controls.layers, *pair)]
    bodies = []
    for index, (mesh, rest) in enumerate(zip(source.meshes, rests, strict=True)):
        points = source.to_world(mesh, time, rest.points) if several else rest.points
        direction, own = controls.directions[index], controls.settings[index]
        mobility = 1.0 if own.mobility is None else own.mobility
        if direction is not None and not several:
            origin = source.to_world(mesh, time, np.zeros_like(direction))
            direction = source.to_local(mesh, time, origin + direction)
        bodies.append(
            Body(
                points,
                outward_faces(mesh, time) if several else mesh.faces,
                diffusion=own.diffusion,
                mobility=0.0 if mesh.collider else mobility,
                pin=controls.pins[index],
                direction=direction,
                rigid=bool(own.rigid),
                layer=controls.layers[index],
                name=mesh.path,
                of_set=mesh.faces_away is not None,
                prop=mesh.prop,
                bends=own.rigid is False,
            )
        )
    return PlacedBodies(bodies, met)


def _told_apart(layers: Sequence[NDArray[np.int32] | None], first: int, second: int) -> bool:
    """Return whether the user says which of two meshes lies farther out; 0 where nothing is said.

    layers: how far out the triangles (F,) of each mesh lie.
    """
    given = [layers[first], layers[second]]
    (low, high), (other_low, other_high) = (
        (0, 0) if own is None else (int(own.min()), int(own.max())) for own in given
    )
    return low > other_high or other_low > high


def _time_of_rest(source: Source, rests: list[Rest]) -> tuple[float, list[tuple[int, int]]]:
    """The time at which the rests, placed in the world, meet each other least, and who meets.

    How they lie there tells what covers what. Of a few frames of the whole clip, so that the parts
    of a farm agree; the first of several.
    """
    from dtrepair.intersect.ignored import CollapsedPoseError
    from dtrepair.intersect.scene_counts import SceneCounter

    count = min(PLACEMENTS, len(source.clip_times))
    chosen = source.clip_times[np.linspace(0, len(source.clip_times) - 1, count).astype(int)]
    times = usable_times(source, chosen) or [placing_time(source, source.clip_times)]
    counter: SceneCounter | None = None
    best, least = float(times[0]), -1
    met: list[tuple[int, int]] = []
    for time in times:
        meshes = zip(source.meshes, rests, strict=True)
        placed = [source.to_world(mesh, time, rest.points) for mesh, rest in meshes]
        if counter is None:
            faces = [mesh.faces for mesh in source.meshes]
            counter = SceneCounter(placed, faces, mode="inter")
        try:
            found = counter(placed)
        except CollapsedPoseError:  # scaled to nothing: it tells nothing
            continue
        pairs = found.total.pairs
        if least < 0 or pairs < least:
            best, least, met = time, pairs, sorted(found.met)
        if pairs == 0:
            break
    return best, met


def unclear_sides(source: Source, pairs: Sequence[tuple[int, int]]) -> list[str]:
    """Return a warning about pairs of meshes of which no frame tells which one is outside.

    Not of those that are never beside each other.
    """
    pairs = pairs_beside(source, pairs)
    if not pairs:
        return []
    first, second = (source.meshes[index].path for index in pairs[0])
    more = f" (and {counted(len(pairs) - 1, 'more pair')})" if len(pairs) > 1 else ""
    return [
        f"{first} and {second}{more} intersect in their rest poses, wherever the clip places "
        "these: name a frame in which they do not with --rest FRAME, or say with --layer which of "
        "them is worn over the other, if one is"
    ]


def outward_faces(mesh: SourceMesh, time: float) -> NDArray[np.int32]:
    """Triangles (F, 3) in world space, flipped where the transform mirrors.

    What is of the set around faces what moves, whichever way it was modelled.
    """
    if mesh.handle is None:
        return mesh.faces
    import usd_io

    faces = usd_io.world_faces(mesh.handle, time)
    return faces if mesh.faces_away is None else turned_over(faces, mesh.faces_away)


def in_units_of_frames(source: Source, options: RepairOptions) -> RepairOptions:
    """Return the options with lengths in the space of the frames instead of stage units.

    One mesh is repaired in its local space, whose units a transform may stretch: the result keeps
    at least the clearance and stays within the largest displacement.
    """
    lengths = options.clearance or options.maximum_displacement is not None
    if not lengths or len(source.meshes) > 1 or not isinstance(source, StageSource):
        return options
    least, most = stretches(source, source.meshes[0], float(source.times[0]))
    limit = options.maximum_displacement
    return replace(
        options,
        clearance=options.clearance / least if options.clearance else 0.0,
        maximum_displacement=None if limit is None else limit / most,
    )
