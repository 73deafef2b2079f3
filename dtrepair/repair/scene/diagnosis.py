"""What a repair could not solve, as values: which bodies still meet, or lie inside each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.diagnosis import (
    Advice,
    Deformation,
    RemainingContact,
    RemainingEnclosure,
    Strain,
    StrainKind,
    part_label,
)
from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, vector_areas
from dtrepair.numerics.metrics import edge_log_ratio, volume
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import Excess


@dataclass(frozen=True, kw_only=True)
class DeformationOptions:
    """From when on a clean result is told to be deformed.

    Args:
        edges: Root mean square of the logarithms of the edges' length ratios: a fifth is seen.
        volume: Change of the volume of a closed body, as a fraction of it.
        little: Of the edges, below which volumes are not compared: a rigid motion changes neither.
        closed: Largest sum of the vector areas of a closed surface, as a fraction of its area.
    """

    edges: float = 0.2
    volume: float = 0.1
    little: float = 0.05
    closed: float = 1e-2


def name_of(scene: Scene, body: int) -> str:
    """Return the name of a body, or its number if there are several."""
    return scene.bodies[body].name or (f"body {body}" if len(scene.bodies) > 1 else "the mesh")


def contacts_left(scene: Scene, pairs: IntArray) -> tuple[RemainingContact, ...]:
    """Return which bodies the pairs (K, 2) of triangles join, those with most pairs first."""
    still = _still(scene, pairs)
    owner = np.sort(scene.body_of[pairs], axis=1)
    combined, place = np.unique(owner, axis=0, return_inverse=True)
    place = place.reshape(-1)
    counts = np.bincount(place, minlength=len(combined))
    held = np.bincount(place, still, minlength=len(combined)).astype(np.int64)
    return tuple(
        RemainingContact(
            name_of(scene, first),
            name_of(scene, second),
            pairs=int(counts[index]),
            held=int(held[index]),
            rigid=first == second and scene.bodies[first].rigid,
        )
        for index in np.argsort(-counts, kind="stable")
        for first, second in [combined[index].tolist()]
    )


def advice_for(scene: Scene, pairs: IntArray) -> tuple[Advice, ...]:
    """Return what a user may do about the pairs (K, 2) that are left, by what was chosen."""
    owner = scene.body_of[pairs]
    rigid = np.array([body.rigid for body in scene.bodies])[owner].all(axis=1)
    rigid &= owner[:, 0] == owner[:, 1]
    still = _still(scene, pairs)
    advice = []
    if not (rigid | still).all():
        if scene.options.maximum_displacement is not None:
            advice.append(Advice.RAISE_MAXIMUM_DISPLACEMENT)
        if scene.options.method == "paper":
            advice.append(Advice.TAKE_FULL_METHOD)
        else:  # Who raised it knows what that gave.
            raised = scene.options.effort > RepairOptions.effort
            advice.append(Advice.EASE_POSE if raised else Advice.RAISE_EFFORT)
        # Of parts that hold each other a wider push leaves more as often as less.
        if scene.attachments is None:
            advice.append(Advice.RAISE_DIFFUSION)
        if any(np.any(body.pin) for body in scene.bodies if body.pin is not None):
            advice.append(Advice.FREE_PINS)
        if scene.rest_intersections:
            advice.append(Advice.GIVE_CLEAN_REST)
        if scene.turning is not None and len(scene.turning.unmodelled(pairs)) < len(pairs):
            advice.append(Advice.CALL_ATTACHED)
    if rigid.any():
        advice.append(Advice.RIGID)
    if still.any():
        advice.append(Advice.HELD)
    return tuple(advice)


def _still(scene: Scene, pairs: IntArray) -> NDArray[np.bool_]:
    """Return which pairs (K, 2) are of triangles no vertex of which may move."""
    return np.asarray((scene.mobility[scene.faces[pairs]] == 0.0).all(axis=(1, 2)))


def enclosures_left(scene: Scene, parts: IntArray) -> tuple[RemainingEnclosure, ...]:
    """Return which parts (K, 2) lie wholly inside which, as the bodies they belong to."""
    bodies = scene.body_of_part[parts].tolist()
    return tuple(
        dict.fromkeys(
            RemainingEnclosure(name_of(scene, inner), name_of(scene, outer))
            for inner, outer in bodies
        )
    )


def deformation_of(
    scene: Scene,
    body: int,
    before: FloatArray,
    after: FloatArray,
    *,
    options: DeformationOptions = DeformationOptions(),
) -> Deformation | None:
    """Return by how much a repair deformed a body, poses (V, 3); None where that is not much."""
    change = edge_log_ratio(before, after, scene.edges_of_bodies[body])
    if change < options.little:
        return None
    faces = scene.faces[scene.triangles_of(body)] - scene.vertex_starts[body]
    areas = vector_areas(before, faces)
    closed = lengths(areas.sum(axis=0)[None])[0] <= options.closed * lengths(areas).sum()
    given = volume(before, faces) if closed else 0.0
    kept = volume(after, faces) / given if given else 1.0
    lost = abs(kept - 1.0) >= options.volume
    if change < options.edges and not lost:
        return None
    return Deformation(name_of(scene, body), float(np.exp(change)), kept if lost else None)


def _label(scene: Scene, part: int) -> str:
    """Return how a connected part is named."""
    parts = scene.strain_meter.parts
    return part_label(name_of(scene, int(parts.body[part])), *parts.number_of(part))


def strains_of(
    scene: Scene, body: int, original: FloatArray, excess: Sequence[Excess]
) -> tuple[Strain, ...]:
    """Return what is beyond its bound in a body, in the pose (V, 3) of the input."""
    parts, size = scene.strain_meter.parts, scene.scale.diagonal(original) if excess else 0.0
    found = []
    for kind, part, value, bound, worst, _, other in excess:
        if parts.body[part] != body:
            continue
        number, count = parts.number_of(part)
        x, y, z = original[worst].tolist()
        vertex = worst - int(scene.vertex_starts[body])
        found.append(
            Strain(
                body=name_of(scene, body),
                part=number,
                parts=count,
                kind=kind,
                value=value,
                bound=bound,
                vertex=vertex,
                place=(x, y, z),
                size=size,
                other=_label(scene, other) if other >= 0 and kind is StrainKind.DRIFT else None,
            )
        )
    return tuple(found)
