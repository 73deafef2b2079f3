"""What a run would do, before it does anything."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from dtrepair.pipeline.selection import ObjectOptions, ObjectSettings
from dtrepair.pipeline.stages.rest import Rest
from dtrepair.pipeline.stages.sources import Source


@dataclass(frozen=True)
class PlannedMesh:
    """One mesh of a run: its size, what was asked of it, and where its rest pose comes from."""

    path: str
    vertices: int
    triangles: int
    rest: str
    settings: ObjectSettings
    collider: bool = False


@dataclass(frozen=True)
class Plan:
    """The meshes and frames of a run, and its output; None: it only counts.

    times: time codes; NaN for the default time, and for mesh files. objects: what options ask of
    single meshes and of pairs.
    """

    meshes: tuple[PlannedMesh, ...]
    times: tuple[float, ...]
    output: str | None
    objects: ObjectOptions = field(default_factory=ObjectOptions)


def make_plan(
    source: Source,
    rests: Sequence[Rest],
    times: Iterable[float],
    output: str | None,
    settings: Sequence[ObjectSettings] = (),
    objects: ObjectOptions | None = None,
) -> Plan:
    """Return the plan of a run over the frames at `times` (T,); the rest as in `Plan`."""
    each = settings or [ObjectSettings()] * len(source.meshes)
    meshes = tuple(
        PlannedMesh(
            mesh.path, len(mesh.rest), len(mesh.faces), rest.origin, own, collider=mesh.collider
        )
        for mesh, rest, own in zip(source.meshes, rests, each, strict=True)
    )
    asked = objects or ObjectOptions()
    return Plan(meshes, tuple(float(time) for time in times), output, asked)
