"""What a repair could not solve, in words: which bodies still meet, or lie inside each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths, vector_areas
from dtrepair.numerics.metrics import edge_log_ratio, volume
from dtrepair.repair.scene.scene import Scene
from dtrepair.wording import counted

# So many pairs of bodies are named.
NAMED = 3
# A clean result is told to be deformed if its edges' lengths changed by more (rms of the logarithms
# of their ratios), or the volume of a closed body by more than this part; volumes are compared
# where the edges changed by more than a little.
DEFORMED, LOST, LITTLE = 0.2, 0.1, 0.05
# The vector areas of a closed surface sum to this part of its area at most.
CLOSED = 1e-2


def name_of(scene: Scene, body: int) -> str:
    """The name of a body, or its number if there are several."""
    return scene.bodies[body].name or (f"body {body}" if len(scene.bodies) > 1 else "the mesh")


def contacts_left(scene: Scene, pairs: IntArray) -> str:
    """Which bodies the pairs (K, 2) of triangles join, and whether they could move at all."""
    if len(pairs) == 0:
        return ""
    still = _still(scene, pairs)
    owner = np.sort(scene.body_of[pairs], axis=1)
    combined, place = np.unique(owner, axis=0, return_inverse=True)
    place = place.reshape(-1)
    counts = np.bincount(place)
    held = np.bincount(place, still).astype(np.int64)
    parts = []
    for index in np.argsort(-counts, kind="stable")[:NAMED]:
        first, second = (name_of(scene, body) for body in combined[index].tolist())
        who = f"{first} and {second} still intersect"
        if combined[index, 0] == combined[index, 1]:
            rigid = ", which is rigid," if scene.bodies[combined[index, 0]].rigid else ""
            who = f"{first}{rigid} still intersects itself"
        where = ""
        if held[index]:
            share = "all" if held[index] == counts[index] else str(held[index])
            where = f", {share} of them where nothing may move"
        parts.append(f"{who} ({counted(int(counts[index]), 'pair')}{where})")
    more = f" and {len(counts) - NAMED} more" if len(counts) > NAMED else ""
    return "; ".join(parts) + more


def cures(scene: Scene, pairs: IntArray) -> str:
    """What a user may do about the pairs (K, 2) that are left, by what was chosen."""
    owner = scene.body_of[pairs]
    rigid = np.array([body.rigid for body in scene.bodies])[owner].all(axis=1)
    rigid &= owner[:, 0] == owner[:, 1]
    still = _still(scene, pairs)
    ways = []
    if not (rigid | still).all():
        if scene.options.maximum_displacement is not None:
            ways.append("raise maximum_displacement")
        if scene.options.method == "paper":
            ways.append("take the method full")
        ways.append("raise the diffusion")
        if any(np.any(body.pin) for body in scene.bodies if body.pin is not None):
            ways.append("free pinned vertices")
        if scene.rest_intersections:
            ways.append("give a rest pose that does not intersect itself")
    sentences = [", or ".join(ways)] if ways else []
    if rigid.any():
        sentences.append("what is rigid cannot be resolved within itself")
    if still.any():
        sentences.append("where nothing may move, nothing can be resolved")
    return "; ".join(sentences)


def _still(scene: Scene, pairs: IntArray) -> NDArray[np.bool_]:
    """Which pairs (K, 2) are of triangles no vertex of which may move."""
    still: NDArray[np.bool_] = (scene.mobility == 0.0)[scene.faces].all(axis=1)
    return np.asarray(still[pairs].all(axis=1))


def enclosed_left(scene: Scene, parts: IntArray) -> str:
    """Which parts (K, 2) lie wholly inside which, as the bodies they belong to."""
    told: dict[str, None] = {}
    for inner, outer in scene.body_of_part[parts].tolist():
        who = name_of(scene, inner)
        where = name_of(scene, outer)
        if inner == outer:
            who, where = f"a part of {who}", "another part of it"
        told[f"{who} lies wholly inside {where}"] = None
    named = list(told)[:NAMED]
    return "; ".join(named) + (f" and {len(told) - NAMED} more" if len(told) > NAMED else "")


def deformed(scene: Scene, body: int, before: FloatArray, after: FloatArray) -> str:
    """By how much a repair deformed a body, poses (V, 3), where that is much; else empty."""
    change = edge_log_ratio(before, after, scene.edges_of_bodies[body])
    if change < LITTLE:
        return ""
    faces = scene.faces[scene.triangles_of(body)] - scene.vertex_starts[body]
    areas = vector_areas(before, faces)
    closed = lengths(areas.sum(axis=0)[None])[0] <= CLOSED * lengths(areas).sum()
    given = volume(before, faces) if closed else 0.0
    part = volume(after, faces) / given if given else 1.0
    if change < DEFORMED and abs(part - 1.0) < LOST:
        return ""
    told = f"lengths by a factor of {np.exp(change):.2f}"
    if abs(part - 1.0) >= LOST:
        told += f", volume to {part:.0%}"
    return (
        f"{name_of(scene, body)} is clean but much deformed ({told}): "
        "look at it, and ease the pose where it is deepest"
    )
