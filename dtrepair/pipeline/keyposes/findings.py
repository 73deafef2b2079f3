"""What is to be looked at in keys and between them, though nothing intersects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.keyposes.spans import KeyPoses
from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.numerics.metrics import JumpMeter
from dtrepair.numerics.scale import Scale
from dtrepair.pipeline.keyposes.solve import StageKeys
from dtrepair.pipeline.repair.motion import Motion, parts_of_mesh
from dtrepair.pipeline.stages.frames import Frame, placed_frame
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
    interpolation: str = "linear",
    *,
    options: KeyJumpOptions = KeyJumpOptions(),
) -> tuple[MotionFinding, ...]:
    """Return what gives way in keys, ends beside others, or jumps where some were added.

    interpolation: of the poses between keys.
    """
    given, motion = keys.given, Motion(source)

    def placed(time: float) -> tuple[Frame, Frame]:
        poses = (
            [own.at(time, interpolation=interpolation) for own in each]
            for each in (given, found.tracks)
        )
        before, after = (placed_frame(source, time, own) for own in poses)
        return before, after

    added = {time for span in found.spans for time in span.added}
    for time in sorted({*keys.selected, *added}):
        before, after = placed(time)
        if before.usable and after.usable:
            motion.add(time, before.spaces, after.spaces)
    # Keys are too far apart to jump.
    told = [own for own in motion.findings() if own.kind is not FindingKind.JUMPS]
    jumps = _Jumps(source, keys.repairer.repairer.scene.scale)
    for run in _whole_frames(source, found):
        jumps.restart()
        for time in run.tolist():
            keys.check()
            jumps.add(time, *placed(time))
    return *told, *jumps.findings(options.farther)


def _whole_frames(source: StageSource, found: KeyPoses) -> list[FloatArray]:
    """Return the whole frames (T,), and the ends, of spans with added keys, neighbours together."""
    from usd_io.frame_grid import frame_grid

    grid, runs = frame_grid(source.meshes[0].handle.stage), list[FloatArray]()
    for span in found.spans:
        frames = grid.filled(np.array([span.start, span.end])) if span.added else None
        if frames is None:  # or they are too many
            continue
        if runs and runs[-1][-1] == frames[0]:
            runs[-1] = np.concatenate([runs[-1], frames[1:]])
        else:
            runs.append(frames)
    return runs


class _Jumps:
    """The jumps of all meshes, frame by frame."""

    def __init__(self, source: StageSource, scale: Scale) -> None:
        self.source, self.scale = source, scale
        self.meters = [JumpMeter(parts_of_mesh(mesh)) for mesh in source.meshes]
        self.sizes, self.size = [0.0 for _ in source.meshes], 0.0

    def add(self, time: float, before: Frame, after: Frame) -> None:
        """Take the next frame, as it came and as it ends; one without points tells nothing."""
        if not (before.usable and after.usable):
            return self.restart()
        self.size = max(self.size, self.scale.diagonal(np.concatenate(before.spaces)))
        each = zip(self.meters, before.spaces, after.spaces, strict=True)
        for index, (meter, own, repaired) in enumerate(each):
            self.sizes[index] = self.sizes[index] or diagonal(np.asarray(own, np.float64))
            meter.add(time, own, repaired)

    def restart(self) -> None:
        """Begin anew: what follows is no neighbour of the frames so far."""
        for meter in self.meters:
            meter.restart()

    def findings(self, farther: float) -> list[MotionFinding]:
        """Return what jumps by more than so much, diagonals of all that is repaired."""
        findings = []
        for mesh, meter, own in zip(self.source.meshes, self.meters, self.sizes, strict=True):
            least = farther * self.size
            jumps = {time: far for time, far in meter.jumps.items() if far * own > least}
            if jumps:
                kind, far = FindingKind.JUMPS, max(jumps.values())
                times = tuple(jumps)
                findings.append(MotionFinding(kind=kind, path=mesh.path, largest=far, times=times))
        return findings
