"""All meshes of an input as one mesh in world space, frame by frame: for pictures and windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.stages.frames import Frame, count_frame, make_counter, read_frame
from dtrepair.pipeline.stages.sources import Source, time_label

if TYPE_CHECKING:
    from dtrepair.numerics.attachments import Attachments


@dataclass(frozen=True)
class SceneFrame:
    """World points of a frame, and what of it intersects.

    Args:
        points: Of all meshes (V, 3).
        intersecting: Mask (F,) of the triangles in pairs that count.
        modelled: Mask (F,) of those that are in modelled pairs only.
        pairs: The pairs (P, 2) that count.
    """

    points: NDArray[np.float64]
    intersecting: NDArray[np.bool_]
    modelled: NDArray[np.bool_]
    pairs: NDArray[np.int32]

    @property
    def counts(self) -> tuple[int, int]:
        """How many triangles intersect, and how many are in modelled pairs only."""
        return int(self.intersecting.sum()), int(self.modelled.sum())


class WorldScene:
    """The meshes of a source joined in world space; `faces` (F, 3), `objects` (F,) their meshes.

    attachments: contacts that were modelled, and do not count.
    """

    def __init__(
        self,
        source: Source,
        *,
        mode: str = "both",
        ignored: Sequence[tuple[int, int]] = (),
        device: str = "cpu",
        attachments: Attachments | None = None,
    ) -> None:
        self.source = source
        self._counter = make_counter(
            source, mode=mode, ignored=ignored, device=device, attachments=attachments
        )
        starts = np.cumsum([0, *(len(mesh.rest) for mesh in source.meshes)])
        meshes = zip(source.meshes, starts, strict=False)
        self.faces = np.concatenate([mesh.faces + start for mesh, start in meshes]).astype(np.int32)
        sizes = [len(mesh.faces) for mesh in source.meshes]
        self.objects = np.repeat(np.arange(len(sizes)), sizes)

    def __call__(self, time: float) -> SceneFrame:
        """Read a frame and count its intersections; a failure where it has no points."""
        frame, found = count_frame(self._counter, read_frame(self.source, time))
        if found is None:
            raise self._refused(frame)
        mask = np.concatenate(found.intersecting)
        modelled = np.zeros(len(mask), dtype=bool)
        modelled[found.modelled.reshape(-1)] = True
        return SceneFrame(self._placed(frame), mask, modelled & ~mask, found.pairs)

    def points(self, time: float) -> NDArray[np.float64]:
        """Read a frame only: world points (V, 3)."""
        frame = read_frame(self.source, time)
        if not frame.usable:
            raise self._refused(frame)
        return self._placed(frame)

    def _refused(self, frame: Frame) -> InputError:
        reason = frame.failure or f"{frame.blocked}: the sample is blocked"
        return InputError(f"{self.source.name}, frame {time_label(frame.time)}: {reason}")

    def _placed(self, frame: Frame) -> NDArray[np.float64]:
        placed: list[NDArray[Any]] = [
            self.source.to_world(mesh, frame.time, part)
            for mesh, part in zip(self.source.meshes, frame.points, strict=True)
        ]
        for index in frame.hidden:
            placed[index] = np.broadcast_to(placed[index][:1], placed[index].shape)
        return np.concatenate(placed)

    def meetings(self, time: float) -> list[tuple[str, str, int]]:
        """Which meshes intersect in a frame, or one itself: paths, and pairs of triangles.

        Those with most come first; a frame without points has none.
        """
        _, found = count_frame(self._counter, read_frame(self.source, time))
        met = found.met if found is not None else {}
        paths = [mesh.path for mesh in self.source.meshes]
        listed = [(paths[i], paths[j], count) for (i, j), count in met.items() if count]
        return sorted(listed, key=lambda own: -own[2])

    def worst(self) -> int:
        """Index of the frame with most intersecting triangles; of several the first.

        Where nothing intersects, that with most modelled contacts.
        """
        times = self.source.times.tolist()
        usable = [k for k, time in enumerate(times) if read_frame(self.source, time).usable]
        if not usable:
            raise InputError(f"{self.source.name}: no frame is usable")
        if len(usable) == 1:
            return usable[0]
        return max(usable, key=lambda index: self(times[index]).counts)
