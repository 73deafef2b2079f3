"""How corrections go in time: their jitter, and frames in which they jump."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from dtrepair.numerics.metrics import JitterMeter, JumpMeter
from dtrepair.pipeline.stages.sources import Source
from dtrepair.wording import frame_list, listed


class Motion:
    """The corrections of all meshes, frame by frame, in memory for three frames."""

    def __init__(self, source: Source) -> None:
        self._paths = [mesh.path for mesh in source.meshes]
        self._jitter = [JitterMeter() for _ in self._paths]
        self._jumps = [JumpMeter() for _ in self._paths]
        self._frames = 0

    def add(self, time: float, before: Sequence[ArrayLike], after: Sequence[ArrayLike]) -> None:
        """Take the next frame: points (V, 3) of the meshes, before and after; none if it failed."""
        self._frames += 1
        meters = zip(self._jitter, self._jumps, before, after, strict=False)
        for jitter, jumps, own, repaired in meters:
            jitter.add(own, repaired)
            jumps.add(time, own, repaired)

    @property
    def jitter(self) -> float | None:
        """The largest jitter of a mesh, see `JitterMeter`; None for fewer than three frames."""
        return max(meter.value for meter in self._jitter) if self._frames > 2 else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """One line on the meshes whose corrections jump, those that jump farthest first."""
        found = zip(self._paths, (meter.jumps for meter in self._jumps), strict=True)
        jumping = [(max(jumps.values()), path, list(jumps)) for path, jumps in found if jumps]
        if not jumping:
            return ()
        names = [
            f"{path} in frame {frame_list(times)} (by up to {100.0 * farthest:.2g} % of its size)"
            for farthest, path, times in sorted(jumping, key=lambda each: -each[0])
        ]
        return (
            f"corrections that jump: {listed(names)}; what moves there stands out from the frames "
            "before and after, perhaps on the other side of something: look at these frames",
        )
