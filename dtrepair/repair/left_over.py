"""What a repair could not solve, in words: which bodies still meet, or lie inside each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dtrepair.geometry import IntArray
from dtrepair.repair.release import bodies_of_parts
from dtrepair.wording import counted

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer

# So many pairs of bodies are named.
NAMED = 3


def name_of(scene: SceneRepairer, body: int) -> str:
    """The name of a body, or its number if there are several."""
    return scene.bodies[body].name or (f"body {body}" if len(scene.bodies) > 1 else "the mesh")


def contacts_left(scene: SceneRepairer, pairs: IntArray) -> str:
    """Which bodies the pairs (K, 2) of triangles join, and whether they could move at all."""
    if len(pairs) == 0:
        return ""
    still = _still(scene, pairs)
    owner = np.sort(scene._body_of[pairs], axis=1)
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


def cures(scene: SceneRepairer, pairs: IntArray) -> str:
    """What a user may do about the pairs (K, 2) that are left, by what was chosen."""
    owner = scene._body_of[pairs]
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


def _still(scene: SceneRepairer, pairs: IntArray) -> NDArray[np.bool_]:
    """Which pairs (K, 2) are of triangles no vertex of which may move."""
    still: NDArray[np.bool_] = (scene._mobility == 0.0)[scene._faces].all(axis=1)
    return np.asarray(still[pairs].all(axis=1))


def enclosed_left(scene: SceneRepairer, parts: IntArray) -> str:
    """Which parts (K, 2) lie wholly inside which, as the bodies they belong to."""
    told: dict[str, None] = {}
    for inner, outer in bodies_of_parts(scene, parts).tolist():
        who = name_of(scene, inner)
        where = name_of(scene, outer)
        if inner == outer:
            who, where = f"a part of {who}", "another part of it"
        told[f"{who} lies wholly inside {where}"] = None
    named = list(told)[:NAMED]
    return "; ".join(named) + (f" and {len(told) - NAMED} more" if len(told) > NAMED else "")
