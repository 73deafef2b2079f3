"""Measures of a result frame by frame: change of volume, and jitter of the correction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import closed_parts, diagonal, weld_map
from dtrepair.numerics.metrics import volume
from dtrepair.pipeline.page.posed_run import PosedRun

Points = NDArray[np.float64]
Faces = NDArray[np.int32]


def frame_measures(run: PosedRun, count: int) -> dict[str, list[float | None]]:
    """Return "volume" and "jitter" of each of `count` frames of a report; empty for one pose only.

    volume: the largest change of an object that is closed, a part of its volume, with its sign.
    jitter: the root mean square second difference of the displacement around a frame, over the
    diagonal; None at the ends.
    """
    if len(run.scenes) < 2:
        return {}
    before, after = run.scenes.values()
    solids = _closed_objects(run, before.points(float(run.times[0])))
    measures: dict[str, list[float | None]] = {n: [None] * count for n in ("volume", "jitter")}
    moved: list[Points] = []
    size = 1.0
    for index, time in enumerate(run.times.tolist()):
        old, new = before.points(time), after.points(time)
        if not moved:
            size = diagonal(old) or 1.0
        measures["volume"][run.numbers[index]] = _volume_change(old, new, solids)
        moved = [*moved[-2:], new - old]
        if len(moved) == 3 and run.numbers[index] - run.numbers[index - 2] == 2:
            second = moved[0] - 2 * moved[1] + moved[2]
            jump = float(np.sqrt(np.mean(np.sum(second**2, axis=1)))) / size
            measures["jitter"][run.numbers[index - 1]] = jump
    return {name: own for name, own in measures.items() if any(v is not None for v in own)}


def _closed_objects(run: PosedRun, points: Points) -> list[Faces]:
    """Triangles of each object that is closed once vertices at one position are one."""
    scene = run.first
    welded = weld_map(points)[scene.faces]
    closed = closed_parts(welded, scene.objects, len(scene.source.meshes))
    return [scene.faces[scene.objects == k] for k in np.flatnonzero(closed)]


def _volume_change(before: Points, after: Points, solids: list[Faces]) -> float | None:
    """Return the largest relative change of the volumes; None where nothing has one."""
    changes = []
    for faces in solids:
        old = volume(before, faces)
        if abs(old) > 0:
            changes.append((volume(after, faces) - old) / abs(old))
    return max(changes, key=abs, default=None)
