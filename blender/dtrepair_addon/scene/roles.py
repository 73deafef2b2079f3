"""Collections and vertex groups as what they say of a run: colliders, ignored pairs, pins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..host.exchange import SampledMesh
from .sampling import SceneError


@dataclass(frozen=True)
class Roles:
    """What single objects do.

    Attributes:
        colliders: collection of what takes part and never moves; None: nothing.
        ignored: collection of meshes whose contacts with each other do not count; None: none.
        pin: name of the vertex groups of what stays; empty: nothing does.
        direction: name of the vertex groups of what is led towards a vector in the world.
        towards: that vector (3,).
    """

    colliders: Any = None
    ignored: Any = None
    pin: str = ""
    direction: str = ""
    towards: tuple[float, float, float] = (0.0, 0.0, 1.0)


def taking_part(selected: Sequence[Any], roles: Roles) -> list[Any]:
    """Return the meshes that take part: those selected, and all colliders."""
    own = [each for each in selected if each.type == "MESH"]
    return own + [each for each in _meshes(roles.colliders) if each not in own]


def ignored_names(objects: Sequence[Any], roles: Roles) -> list[tuple[str, str]]:
    """Return the pairs of names whose contacts do not count."""
    among = [each.name for each in objects if each in _meshes(roles.ignored)]
    return list(combinations(among, 2))


def with_roles(
    objects: Sequence[Any], meshes: Sequence[SampledMesh], roles: Roles
) -> list[SampledMesh]:
    """Return the meshes with their roles.

    Raises:
        SceneError: no object has a vertex group that was named, or modifiers add vertices, which
            have no weights then.
    """
    colliders = _meshes(roles.colliders)
    pins = _weights(objects, meshes, roles.pin)
    led = _weights(objects, meshes, roles.direction)
    towards = np.array(roles.towards, dtype=np.float32)
    return [
        replace(
            mesh,
            collider=each in colliders,
            pin=pin,
            direction=(own > 0.0)[:, None] * towards if own is not None else None,
        )
        for each, mesh, pin, own in zip(objects, meshes, pins, led, strict=True)
    ]


def _meshes(collection: Any) -> list[Any]:
    return [o for o in collection.all_objects if o.type == "MESH"] if collection else []


def _weights(
    objects: Sequence[Any], meshes: Sequence[SampledMesh], name: str
) -> list[NDArray[np.float32] | None]:
    """Return weights (V,) of a vertex group of each object; None where it has no such group."""
    if not name:
        return [None] * len(objects)
    found = [_group(each, mesh, name) for each, mesh in zip(objects, meshes, strict=True)]
    if all(weights is None for weights in found):
        raise SceneError(f"nothing has a vertex group {name}; paint one, or clear the name")
    return found


def _group(target: Any, mesh: SampledMesh, name: str) -> NDArray[np.float32] | None:
    group = target.vertex_groups.get(name)
    if group is None:
        return None
    if len(target.data.vertices) != len(mesh.rest):
        raise SceneError(f"{target.name}: modifiers add vertices, which no vertex group has")
    weights = np.zeros(len(mesh.rest), np.float32)
    for vertex in target.data.vertices:
        for own in vertex.groups:
            if own.group == group.index:
                weights[vertex.index] = min(max(own.weight, 0.0), 1.0)
    return weights
