"""Contacts of what may not move, or keeps its shape: not repaired, not counted, but told."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dtrepair.pipeline.stages.bodies import Controls
from dtrepair.pipeline.stages.sources import Source, time_label
from dtrepair.wording import counted, listed

if TYPE_CHECKING:
    from dtrepair.intersect.scene_counts import SceneCount


class ColliderContacts:
    """Pairs of colliders that intersect, each in the first frame in which they do.

    Args:
        source: The meshes.
        looked_for: Pairs (i, j) of colliders; i is j for one, or a rigid mesh, with itself.
    """

    def __init__(self, source: Source, looked_for: Sequence[tuple[int, int]]) -> None:
        self._source, self._open = source, set(looked_for)
        sizes = [len(mesh.faces) for mesh in source.meshes]
        self._mesh_of = np.repeat(np.arange(len(sizes)), sizes)
        # Of each pair that was found the time, and how many of their triangles intersect then.
        self._found: dict[tuple[int, int], tuple[float, int]] = {}

    def see(self, time: float, count: SceneCount | None) -> None:
        """Look at all pairs of triangles of a frame; frames come in order."""
        if count is None or not self._open or not len(count.every_pair):
            return
        meshes = np.sort(self._mesh_of[count.every_pair], axis=1)
        met, numbers = np.unique(meshes, axis=0, return_counts=True)
        for (i, j), number in zip(met.tolist(), numbers.tolist(), strict=True):
            if (i, j) in self._open:
                self._found[i, j] = time, number
                self._open.remove((i, j))

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line on those that were found, those with most pairs first; one on single meshes."""
        order = sorted(self._found, key=lambda pair: (-self._found[pair][1], pair))
        each = [self._told(*pair) for pair in order if pair[0] != pair[1]]
        alone = [self._told(*pair) for pair in order if pair[0] == pair[1]]
        told = []
        if each:
            told.append(
                f"colliders that intersect each other: {listed(each)}; as neither may move, that "
                "is neither repaired nor counted here; check counts it"
            )
        if alone:
            told.append(
                f"colliders or rigid, and intersect themselves: {listed(alone)}; as the "
                "repair bends none of them, that is neither repaired nor counted here; "
                "check counts it"
            )
        return tuple(told)

    def _told(self, first: int, second: int) -> str:
        time, number = self._found[first, second]
        when = "" if math.isnan(time) else f" in frame {time_label(time)}"
        paths = dict.fromkeys(self._source.meshes[own].path for own in (first, second))
        return f"{' and '.join(paths)} ({counted(number, 'pair')}{when})"


def colliders_of(
    source: Source, controls: Controls, mode: str, rests: Sequence[int | None]
) -> ColliderContacts:
    """Return what looks for contacts of colliders, and of what keeps its shape, that may count.

    rests: intersecting triangles of the rest poses: of meshes that have any a warning tells before.
    """
    counted_at_all = [
        (i, j)
        for i, j in controls.unmovable
        if (mode != "inter" and not rests[i] if i == j else mode != "self")
    ]
    return ColliderContacts(source, counted_at_all)
