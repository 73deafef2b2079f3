"""Where the frames of a window begin: what is enclosed led out, layers lifted, bodies led apart."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.separation.layer_lift import LiftOptions
from dtrepair.repair.separation.lifting import lifted_frames, not_worn, parts_that_meet
from dtrepair.repair.separation.release import ReleaseOptions, released_frames
from dtrepair.repair.separation.separation import SeparationOptions, separated_frames
from dtrepair.repair.separation.sunken import SunkenOptions, raised_frames
from dtrepair.repair.separation.untangling import contact_counts, tangled_contacts


class Solved(NamedTuple):
    """What was found for frames: poses (V, 3), and how far (T, V, 3) they were led before.

    By what leads enclosed parts out and bodies apart; lifts of layers are not among it.
    """

    poses: list[FloatArray]
    leads: FloatArray


class Starts:
    """The poses from which frames are solved.

    Args:
        scene, mesh: What is solved.
        frames: The frames of a window, their contacts known.
        times: Times (T,) in frame units.
        release: How enclosed parts are led out.
        lift: How layers are led back over what came through them.
        sunken: How parts that sank into what they sit on are led out.
        separation: How bodies that penetrate each other are led apart.
    """

    def __init__(
        self,
        scene: Scene,
        mesh: WeldedMesh,
        frames: Sequence[OpenedPose],
        times: FloatArray,
        *,
        release: ReleaseOptions = ReleaseOptions(),
        lift: LiftOptions = LiftOptions(),
        sunken: SunkenOptions = SunkenOptions(),
        separation: SeparationOptions = SeparationOptions(),
    ) -> None:
        self.scene, self.mesh, self.times, self.separation = scene, mesh, times, separation
        self.pairs = [frame.pairs for frame in frames]
        self.inputs = starts = np.stack([frame.centred for frame in frames])
        if any(len(frame.enclosed) for frame in frames):
            enclosed = [not_worn(scene, frame.enclosed) for frame in frames]
            starts = released_frames(scene, starts, enclosed, times, options=release)
        starts = raised_frames(scene, starts, self.pairs, times, options=sunken)
        met = [parts_that_meet(scene, frame.pairs, frame.enclosed) for frame in frames]
        self.lifted = lifted_frames(scene, starts, met, times, options=lift)
        self._unlifted = starts
        # Poses (T, V, 3).
        self.led = self._separated()

    def unlifted(self, poses: FloatArray) -> FloatArray:
        """Return poses (T, V, 3) that were led from here, without the lifts of layers."""
        lift = self.lifted - self._unlifted
        # What was led no farther is what it was before, to the bit.
        return np.where(poses == self.lifted, self._unlifted, poses - lift)

    def otherwise(self, left: Sequence[IntArray]) -> FloatArray | None:
        """Return poses (T, V, 3) with sheets, and what solving left as it was, led apart as well.

        left: for each frame the pairs (K, 2), triangles of the mesh. None where that changes
        nothing.
        """
        met = [contact_counts(self.scene.body_of, found) for found in self.pairs]
        still = [contact_counts(self.mesh.surface.body_of, found) for found in left]
        tangled = tangled_contacts(met, still, options=self.separation.untangling)
        poses = self._separated(range(len(self.scene.bodies)), tangled)
        return None if np.array_equal(poses, self.led) else poses

    def _separated(
        self,
        sheets: Collection[int] = (),
        tangled: frozenset[tuple[int, int]] = frozenset(),
    ) -> FloatArray:
        return separated_frames(
            self.scene,
            self.mesh,
            self.lifted,
            self.pairs,
            self.times,
            sheets=sheets,
            tangled=tangled,
            options=self.separation,
        )
