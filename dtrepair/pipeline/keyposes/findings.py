"""What is to be looked at in keys and between them, though nothing intersects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.keyposes.spans import KeyPoses
from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.metrics import JumpMeter
from dtrepair.pipeline.keyposes.solve import StageKeys
from dtrepair.pipeline.repair.motion import Motion
from dtrepair.pipeline.stages.sources import StageSource
from dtrepair.report.findings import FindingKind, MotionFinding


@dataclass(frozen=True, kw_only=True)
class KeyJumpOptions:
    """Which jumps are told of corrections that were written for keys.

    Args:
        farther: A mesh jumps by more than this, diagonals of all that is repaired: where a
            correction goes from one key to the next it turns at each of them, which nobody sees.
    """

    farther: float = 0.02


def key_findings(
    source: StageSource,
    keys: StageKeys,
    found: KeyPoses,
    *,
    options: KeyJumpOptions = KeyJumpOptions(),
) -> tuple[MotionFinding, ...]:
    """Return what gives way in chosen keys, ends beside others, or jumps where keys were added."""
    motion = Motion(source)
    for time in keys.selected:
        if keys.frames[time].usable:
            motion.add(time, *_poses(keys, found, time))
    # Given keys are too far apart to jump.
    given = [own for own in motion.findings() if own.kind is not FindingKind.JUMPS]
    return *given, *_jumps(source, keys, found, options.farther)


def _poses(keys: StageKeys, found: KeyPoses, time: float) -> tuple[list[np.ndarray], ...]:
    """Return points (V, 3) of all meshes at a time, as they came and as they end."""
    return tuple([own.at(time) for own in each] for each in (keys.given, found.tracks))


def _jumps(
    source: StageSource, keys: StageKeys, found: KeyPoses, farther: float
) -> list[MotionFinding]:
    """Return what jumps on the whole frames of spans in which keys were added."""
    from usd_io.frame_grid import frame_grid

    scale = keys.repairer.repairer.scene.scale
    grid, meters = frame_grid(source.meshes[0].handle.stage), [JumpMeter() for _ in source.meshes]
    sizes, size = [0.0 for _ in source.meshes], 0.0
    for span in found.spans:
        frames = grid.filled(np.array([span.start, span.end])) if span.added else None
        for time in () if frames is None else frames.tolist():
            before, after = (keys.frame(time, own).spaces for own in _poses(keys, found, time))
            size = max(size, scale.diagonal(np.concatenate(before)))
            for index, (meter, *poses) in enumerate(zip(meters, before, after, strict=True)):
                sizes[index] = sizes[index] or diagonal(np.asarray(poses[0], np.float64))
                meter.add(time, *poses)
        for meter in meters:
            meter.restart()
    findings = []
    for mesh, meter, own in zip(source.meshes, meters, sizes, strict=True):
        jumps = {time: far for time, far in meter.jumps.items() if far * own > farther * size}
        if jumps:
            kind, largest = FindingKind.JUMPS, max(jumps.values())
            findings.append(
                MotionFinding(kind=kind, path=mesh.path, largest=largest, times=tuple(jumps))
            )
    return findings
