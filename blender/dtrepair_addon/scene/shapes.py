"""The shape keys of a repair: fitted frame by frame, then as few as come near enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..host.exchange import FloatArray, SampledMesh
from ..host.runs import moved
from .copies import trial
from .shape_keys import Keys, add_keys, fewest, fitted, size_of


class Shapes:
    """Shape keys that lead meshes to points (T, V, 3) at frames.

    Nothing of them stays in the scene before `add`.

    Args:
        frames: of the poses.
        meshes: as they were sampled.
        points: of each mesh, as they should be.
    """

    def __init__(
        self, frames: Sequence[int], meshes: Sequence[SampledMesh], points: Sequence[FloatArray]
    ) -> None:
        self._frames, self._meshes, self._points = frames, meshes, points
        both = list(zip(meshes, points, strict=True))
        places = [place for place, (m, own) in enumerate(both) if len(moved(m.points, own))]
        self._offsets = {place: np.zeros(points[place].shape) for place in places}
        changed = np.any([(m.points != own).any(axis=(1, 2)) for m, own in both], axis=0)
        self._left = np.flatnonzero(changed).tolist()
        self._number = len(self._left)
        self._keys: dict[int, list[Keys]] = {}

    @property
    def fitted(self) -> float:
        """The share of frames that are fitted."""
        return 1.0 - len(self._left) / max(self._number, 1)

    def fit(self, originals: Mapping[int, Any]) -> None:
        """Fit one more frame, so that Blender stays usable in between."""
        index = self._left.pop()
        with trial(originals) as copies:
            for place, copy in copies.items():
                before, wanted = self._meshes[place].points[index], self._points[place][index]
                self._offsets[place][index] = fitted(copy, self._frames[index], before, wanted)

    def choose(self, tolerance: float) -> None:
        """Choose the fewest keys for a tolerance, a part of the size of each mesh."""
        for place, offsets in self._offsets.items():
            allowed = tolerance * size_of(self._meshes[place].rest)
            self._keys[place] = fewest(self._frames, offsets, allowed)

    def add(self, copies: Mapping[int, Any]) -> None:
        """Give copies of the objects the keys that were chosen."""
        for place, copy in copies.items():
            add_keys(copy, self._keys[place])
