"""The scene of some bodies, checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dtrepair.numerics.attached.seams import find_seams
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.enclosure import turned_over
from dtrepair.numerics.worn.linings import linings
from dtrepair.numerics.worn.parts import Parts
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.bodies import (
    Body,
    check_clearance,
    checked_ignored,
    checked_meshes,
    direction_of,
    mobility_of,
)
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import StrainOptions
from dtrepair.repair.surface.containment import meshes_oriented_outwards


def make_scene(
    bodies: Sequence[Body],
    options: RepairOptions,
    ignore: Sequence[tuple[int, int]] = (),
    references: Sequence[Reference] = (),
    layer_poses: Sequence[Reference] = (),
    *,
    strain: StrainOptions = StrainOptions(),
    device: str = "cpu",
) -> Scene:
    """Return the scene of some bodies, whose contacts between pairs in `ignore` do not count.

    references, layer_poses, strain, device: see `Scene`.

    Raises:
        ValueError: bodies, options or pairs that cannot be used.
    """
    ignored, meshes = checked_ignored(ignore, len(bodies)), checked_meshes(bodies)
    outwards = meshes_oriented_outwards(meshes)
    meshes = [(points, faces) for (points, _), faces in zip(meshes, outwards, strict=True)]
    rest = np.concatenate([points for points, _ in meshes])
    check_clearance(options.clearance, rest)
    vertex_starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    shifted = [faces + start for (_, faces), start in zip(meshes, vertex_starts, strict=False)]
    sized = [(body, len(points)) for body, (points, _) in zip(bodies, meshes, strict=True)]
    scene = Scene(
        bodies=tuple(bodies),
        options=options,
        ignored=ignored,
        rest=rest,
        faces=np.concatenate(shifted).astype(np.int32),
        vertex_starts=vertex_starts,
        triangle_starts=np.cumsum([0, *(len(faces) for _, faces in meshes)]),
        mobility=np.concatenate([mobility_of(body, count) for body, count in sized]),
        direction=np.concatenate([direction_of(body, count) for body, count in sized]),
        references=tuple(references),
        layer_poses=tuple(layer_poses),
        strain=strain,
        device=device,
    )
    return _linings_turned(scene)


def _linings_turned(scene: Scene) -> Scene:
    """Return a scene with the triangles of linings turned round, as those of closed parts are.

    A lining that is sewn to its coat goes on in it: the two are one skin, whose sides are known.
    """
    parts = scene.enclosures
    if scene.options.method != "full" or parts.closed.all():
        return scene
    pose = scene.layer_poses[0].points if scene.layer_poses else scene.rest
    found = linings(Parts(parts.faces, parts.part, parts.closed, [pose]))
    if found:
        seams = find_seams(scene.centred_rest, parts.faces, parts.part)
        sewn = parts.part[seams.chosen(seams.across(parts.part)).vertices]
        found = np.setdiff1d(found, sewn).tolist()
    if not found:
        return scene
    turned = np.isin(parts.part_of_face, found)
    return replace(scene, faces=turned_over(scene.faces, turned))
