"""Things that one joint or one transform carries are rigid, where bending them strains them.

A rifle, a shield or a plate that moves as a whole in the input was never meant to bend.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, diagonal, lengths
from dtrepair.repair.scene.bodies import mobility_of
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.surface.rigid_bodies import RigidBodies

# Strains of a shape, not of where it is.
SHAPE = (StrainKind.EDGES, StrainKind.VOLUME, StrainKind.LIMB, StrainKind.FLIPS)


@dataclass(frozen=True, kw_only=True)
class PropOptions:
    """What moves as a whole.

    Args:
        rounding: Vertices are at most so far from a rigid motion of the rest, units of the extent
            of the body: skinning in single precision rounds.
    """

    rounding: float = 1e-4


def bent_bodies(scene: Scene, judged: Judged) -> set[int]:
    """Return which bodies are strained in their shape in a pose that was judged."""
    body = scene.strain_meter.parts.body
    return {int(body[own.part]) for own in judged.excess if own.kind in SHAPE}


def props_among(
    scene: Scene,
    bodies: Collection[int],
    poses: Sequence[FloatArray],
    *,
    options: PropOptions = PropOptions(),
) -> tuple[int, ...]:
    """Return which of some bodies move as wholes in all poses (V, 3) of the input."""
    return tuple(
        body
        for body in sorted(bodies)
        if not scene.bodies[body].rigid
        and all(_goes_whole(scene, body, pose, options) for pose in poses)
    )


def _goes_whole(scene: Scene, body: int, pose: FloatArray, options: PropOptions) -> bool:
    """Return whether a body of a pose (V, 3) is a rigid motion of its rest."""
    own = scene.vertices_of(body)
    rest = scene.centred_rest[own]
    whole = RigidBodies([(0, len(rest))], np.ones(len(rest))).fitted(rest, pose[own])
    far = float(lengths(whole - pose[own]).max(initial=0.0))
    return far <= options.rounding * diagonal(rest)


def with_rigid(scene: Scene, bodies: Sequence[int]) -> Scene:
    """Return a scene in which some bodies are rigid; what is known of it stays known."""
    own = [replace(body, rigid=k in bodies or body.rigid) for k, body in enumerate(scene.bodies)]
    mobility = scene.mobility.copy()
    for index in bodies:
        vertices = scene.vertices_of(index)
        mobility[vertices] = mobility_of(own[index], len(mobility[vertices]))
    forgotten = "rigid", "strain_meter", "seams", "rest_sewn"
    return scene.changed(*forgotten, bodies=tuple(own), mobility=mobility)
