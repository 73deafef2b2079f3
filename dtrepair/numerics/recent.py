"""What was found last is kept for the same poses."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from dtrepair.numerics.geometry import FloatArray

T = TypeVar("T")


class Recent(Generic[T]):
    """What a function said of the poses (V, 3) that it was asked last.

    Poses are compared by their values, so that they may be changed in place; what was found is
    shared, and must not be. Threads may ask it.
    """

    def __init__(self) -> None:
        self._known: tuple[tuple[FloatArray, ...], T] | None = None

    def __call__(self, find: Callable[..., T], *poses: FloatArray) -> T:
        """Return what a function, always the same one, finds of these poses."""
        known = self._known
        if known is None or not _same(known[0], poses):
            known = self._known = tuple(pose.copy() for pose in poses), find(*poses)
        return known[1]

    def __getstate__(self) -> dict[str, object]:
        """Forget what is known: another process finds it again."""
        return {"_known": None}


def _same(first: tuple[FloatArray, ...], second: tuple[FloatArray, ...]) -> bool:
    both = zip(first, second, strict=False)
    return len(first) == len(second) and all(np.array_equal(*pair) for pair in both)
