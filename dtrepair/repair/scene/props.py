"""Things that one joint or one transform carries are rigid, where bending them strains them.

A rifle, a shield or a plate that moves as a whole in the input was never meant to bend; nor were
the bodies of a machine, which are most of what moves.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.attachments import Reference
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


@dataclass(frozen=True, kw_only=True)
class MachineOptions:
    """Which bodies that move as wholes are a machine, and when they stay rigid.

    Args:
        share: They have this share of the triangles of all that moves.
        turning: Those of them that move against the largest one have this share: others stand in
            the pose of the rest.
        against: How far they do so in some pose, diagonals.
        left: By itself the worst frame keeps at most this share of its pairs, and of parts inside
            others, where they are rigid.
    """

    share: float = 2.0 / 3.0
    turning: float = 1.0 / 3.0
    against: float = 0.01
    left: float = 0.1


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


def machine_bodies(
    scene: Scene, poses: Sequence[FloatArray], *, options: MachineOptions = MachineOptions()
) -> tuple[int, ...]:
    """Return the bodies that move as wholes in all poses (V, 3); none unless they are a machine.

    A body of which somebody says how it bends, or where it is held, is not among them.
    """
    bodies = scene.bodies
    moving = [k for k in range(len(bodies)) if not scene.never_moves[k]]
    free = [k for k in moving if not bodies[k].bends and bodies[k].diffusion is None]
    whole = props_among(scene, [k for k in free if bodies[k].pin is None], poses)
    sizes = np.diff(scene.triangle_starts)
    most = sizes[moving].sum()
    if sizes[list(whole)].sum() < max(options.share * most, 1):
        return ()
    largest = max(whole, key=lambda body: int(sizes[body]))
    turning = _moving_against(scene, whole, largest, poses, options)
    return whole if sizes[turning].sum() >= options.turning * most else ()


def _moving_against(
    scene: Scene,
    whole: Sequence[int],
    largest: int,
    poses: Sequence[FloatArray],
    options: MachineOptions,
) -> list[int]:
    """Return which bodies that move as wholes move against the largest of them in some pose."""
    weights = np.zeros(len(scene.rest))
    weights[scene.vertices_of(largest)] = 1.0
    carried = RigidBodies([(0, len(weights))], weights)
    far = np.zeros(len(weights))
    for pose in poses:
        far = np.maximum(far, lengths(carried.fitted(scene.centred_rest, pose) - pose))
    least = options.against * scene.scale.diagonal(scene.centred_rest)
    return [body for body in whole if far[scene.vertices_of(body)].max() > least]


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


def as_wholes(scene: Scene, bodies: Sequence[int]) -> Scene:
    """Return a scene in which some bodies are rigid, and have no contacts and joints of their own.

    What overlaps within a body that moves as a whole does so in every pose.
    """
    rigid = with_rigid(scene, bodies)

    def between(reference: Reference) -> Reference:
        first, second = scene.body_of[reference.pairs].T
        return reference._replace(
            pairs=reference.pairs[(first != second) | ~np.isin(first, bodies)]
        )

    return replace(
        scene,
        bodies=rigid.bodies,
        mobility=rigid.mobility,
        ignored=(*scene.ignored, *((k, k) for k in bodies)),
        references=tuple(map(between, scene.references)),
    )
