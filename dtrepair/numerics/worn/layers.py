"""The layers of a scene: of any two connected parts the one that lies over the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import IntArray
from dtrepair.numerics.worn.around import find_around, find_worn
from dtrepair.numerics.worn.parts import Parts
from dtrepair.numerics.worn.sides import (
    LayerOptions,
    WornLayer,
    Zone,
    find_layer,
    find_sheet,
    layer_over,
)


class Layers:
    """Which parts lie over which; looked at when asked for, and then known.

    Args:
        parts: The parts and the poses that tell.
        pairs: Of each pose the intersecting pairs (K, 2) of triangles.
        numbers: How far out each part lies, as the user says: of two the higher one is outside,
            whatever the poses tell; None, or two that are equal: the poses tell.
        zone: The vertices (N,) of the first of two parts near where it is attached to the second,
            None if it is not. Only open sheets and numbers tell of attached parts: an arm lies
            beside its body from the shoulder on, and is no layer of it.
        options: What counts as a layer.
    """

    def __init__(
        self,
        parts: Parts,
        pairs: Sequence[IntArray],
        *,
        numbers: IntArray | None = None,
        zone: Zone = lambda first, second: None,
        options: LayerOptions = LayerOptions(),
    ) -> None:
        self.parts, self.options, self._zone = parts, options, zone
        self._numbers = np.zeros(len(parts.closed), dtype=np.int32) if numbers is None else numbers
        part_of_face = parts.part[parts.faces[:, 0]]
        self._met = [_counts(part_of_face[found]) for found in pairs]
        self._known: dict[tuple[int, int], WornLayer | None] = {}

    def between(self, first: int, second: int) -> WornLayer | None:
        """Return the layer that one of two parts is over the other; None where neither is.

        Poses in which the two do not meet tell it, else those in which they have fewest pairs.
        """
        key = min(first, second), max(first, second)
        if key not in self._known:
            counts = np.array([met.get(key, 0) for met in self._met])
            poses = np.argsort(counts, kind="stable")[: self.options.poses]
            if counts[poses[0]] == 0:
                poses = poses[counts[poses] == 0]
            self._known[key] = self._found(*key, poses.tolist())
        return self._known[key]

    def is_told(self, first: int, second: int) -> bool:
        """Return whether the user's numbers say which of two parts is outside."""
        return bool(self._numbers[first] != self._numbers[second])

    def _found(self, first: int, second: int, poses: list[int]) -> WornLayer | None:
        """Return the layer of two parts, as the user or else the poses tell; None where neither."""
        over = int(self._numbers[first]) - int(self._numbers[second])
        if over != 0:
            top, under = (first, second) if over > 0 else (second, first)
            layer = layer_over(self.parts, top, under, poses[0], options=self.options)
            return self._free(layer)
        parts, options, pose = self.parts, self.options, poses[0]
        if self._zone(first, second) is None:
            found = find_layer(parts, first, second, poses, options=options)
        else:
            found = find_sheet(parts, first, second, pose, zone=self._zone, options=options)
        if found is None:
            found = find_worn(parts, first, second, pose, options=options)
            # Of two open limbs that are stuck together neither is worn.
            if found and self._zone(first, second) is not None and not parts.closed[found.under]:
                return None
        if found is None and self._zone(first, second) is None:
            found = find_around(parts, first, second, pose, options=options)
        return found and self._free(found)

    def _free(self, layer: WornLayer) -> WornLayer | None:
        """Return a layer without what is attached to what it lies over; None without any other."""
        zone = self._zone(layer.top, layer.under)
        if zone is not None:
            free = ~np.isin(layer.vertices, zone)
            names = ("vertices", "sides", "heights")
            layer = layer._replace(**{name: getattr(layer, name)[free] for name in names})
        return layer if len(layer.vertices) else None


def median_of_parts(numbers: IntArray, part_of_face: IntArray, count: int) -> IntArray:
    """Return the median (count,) of the numbers (F,) of each part's triangles, the higher one."""
    order = np.lexsort((numbers, part_of_face))
    sizes = np.bincount(part_of_face, minlength=count)
    middle = np.cumsum(sizes) - sizes + sizes // 2
    return np.asarray(numbers[order][middle], dtype=np.int32)


def _counts(parts: NDArray[np.integer]) -> dict[tuple[int, int], int]:
    """Return how many pairs (K, 2) of parts there are of each, (smaller, larger)."""
    both, counts = np.unique(np.sort(parts, axis=1), axis=0, return_counts=True)
    return {(int(a), int(b)): int(n) for (a, b), n in zip(both, counts, strict=True)}
