"""What a repair could not solve, in words: which bodies still meet, or lie inside each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

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
    still = (scene._mobility == 0.0)[scene._faces].all(axis=1)[pairs].all(axis=1)
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
            who = f"{first} still intersects itself"
        where = ""
        if held[index]:
            share = "all" if held[index] == counts[index] else str(held[index])
            where = f", {share} of them where nothing may move"
        parts.append(f"{who} ({counted(int(counts[index]), 'pair')}{where})")
    more = f" and {len(counts) - NAMED} more" if len(counts) > NAMED else ""
    return "; ".join(parts) + more


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
