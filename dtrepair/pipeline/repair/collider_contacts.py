"""Contacts of colliders with each other: nobody repairs or counts them, and so they are told."""

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
        looked_for: Pairs (i, j), i < j, of colliders.
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
        """One line on those that were found, those with most pairs first."""
        if not self._found:
            return ()
        order = sorted(self._found, key=lambda pair: (-self._found[pair][1], pair))
        names = listed([self._told(*pair) for pair in order])
        return (
            f"colliders that intersect each other: {names}; as neither may move, that is neither "
            "repaired nor counted here; check counts it",
        )

    def _told(self, first: int, second: int) -> str:
        time, number = self._found[first, second]
        when = "" if math.isnan(time) else f" in frame {time_label(time)}"
        meshes = self._source.meshes
        return f"{meshes[first].path} and {meshes[second].path} ({counted(number, 'pair')}{when})"


def colliders_of(source: Source, controls: Controls, mode: str) -> ColliderContacts:
    """Return what looks for contacts of colliders, where contacts of two meshes count at all."""
    return ColliderContacts(source, () if mode == "self" else controls.between_colliders)
