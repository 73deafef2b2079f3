"""The frames of a run with their points and pairs, each read and counted once."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np

from dtrepair.display.closeups import Posed
from dtrepair.display.contact_events import NO_PAIRS, FramePairs
from dtrepair.pipeline.page.posed_run import PosedRun


class PosedClip:
    """The frames of a run with their pairs, each counted once. Frames are numbers in the run.

    kept: so many frames are kept with their points.
    """

    def __init__(self, report: Mapping[str, Any], run: PosedRun, *, kept: int = 40) -> None:
        self.run, self._report = run, report
        self._pairs: dict[int, FramePairs] = {}
        self._poses = lru_cache(kept)(self._read)

    def looked_at(self, most: int) -> list[int]:
        """Frames that intersect, evenly thinned out to so many, with the worst of all."""
        weights = {k: n for k in range(len(self.run.numbers)) if (n := sum(self._told(k)))}
        found = sorted(weights)
        if len(found) > most:
            chosen = {found[k] for k in np.linspace(0, len(found) - 1, most).astype(int)}
            found = sorted(chosen | {max(weights, key=lambda k: weights[k])})
        return found

    def pairs(self, index: int) -> FramePairs:
        """The pairs of a frame; those of a result with one pose count as before."""
        if index not in self._pairs:
            found = {}
            for name, told in zip(self.run.scenes, self._told(index), strict=False):
                scene = self.run.scenes[name]
                found[name] = scene(float(self.run.times[index])).pairs if told else NO_PAIRS
            self._pairs[index] = FramePairs(*found.values())
        return self._pairs[index]

    def poses(self, index: int) -> list[Posed]:
        """The poses of a frame with all their intersecting triangles."""
        return self._poses(index)

    def _read(self, index: int) -> list[Posed]:
        pairs = self.pairs(index)
        posed = []
        for scene, own in zip(self.run.scenes.values(), (pairs.before, pairs.after), strict=False):
            red = np.zeros(len(scene.faces), dtype=bool)
            red[own] = True
            posed.append(Posed(scene.points(float(self.run.times[index])), red))
        return posed

    def _told(self, index: int) -> tuple[int, int]:
        """Pairs before and after, as the report has them."""
        frame = self._report["frames"][self.run.numbers[index]]
        before, after = (frame[when]["pairs"] for when in ("before", "after"))
        return (after, 0) if "transferred" in self.run.scenes else (before, after)
