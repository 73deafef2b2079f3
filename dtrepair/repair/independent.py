"""Poses of a scene, each for itself: open, lead apart, solve, verify; solved at once on a GPU."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dtrepair.intersect.proximity import close_pairs
from dtrepair.numerics.geometry import FloatArray, IntArray, extent
from dtrepair.numerics.metrics import displacements, edge_log_ratio
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.method import FullOptions
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.relief.approach import ApproachOptions, bounded_approach
from dtrepair.repair.relief.relief import ReliefOptions, relieved_poses
from dtrepair.repair.result import RepairResult, Solved
from dtrepair.repair.scene.bounds import Judged, bounded_pose
from dtrepair.repair.scene.mending import mended
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.results import kept, results_of
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.separation.layer_lift import LiftOptions
from dtrepair.repair.separation.lifting import lifted_frames, not_worn, parts_that_meet
from dtrepair.repair.separation.penetration import BodyShape, find_inside
from dtrepair.repair.separation.release import ReleaseOptions, released
from dtrepair.repair.separation.separation import SeparationOptions, separated_frames
from dtrepair.repair.separation.sunken import SunkenOptions, raised_frames
from dtrepair.repair.separation.untangling import contact_counts, tangled_contacts
from dtrepair.repair.strain.meter import StrainOptions
from dtrepair.repair.strain.shares import ShareOptions
from dtrepair.repair.surface.surface import BoolArray

if TYPE_CHECKING:
    # PyTorch is loaded for the published method only.
    from dtrepair.repair.paper.method import PaperOptions


@dataclass(frozen=True, kw_only=True)
class IndependentOptions:
    """How single poses are led apart, and which of them are solved once more.

    Args:
        torn: A body is torn if its edges changed by more, the rms of the logarithms of their
            ratios.
        sides: What is pressed by so many other bodies has no way out, and is left as it is.
        pressed: Distance of a body that presses, as a fraction of the size of the torn one.
        mend_step, mend: Largest motion, units of the size, and numbers of the mending of a share.
        strain: What a correction may do to a shape.
        relief: How what is strained is relaxed once more.
        approach: How what is strained or has pairs all the same is led in from the rest.
        share: How the share of a correction is found that does not do more.
        release: How enclosed parts are led out.
        lift, sunken: How layers are led back over what came through them, and parts out of what
            they sit on.
        separation: How bodies that penetrate each other are led apart.
        full: Numbers of the full method.
        paper: Numbers of the published method; None: `PaperOptions()`.
    """

    torn: float = 0.1
    sides: int = 3
    pressed: float = 0.01
    mend_step: float = 0.002
    mend: MendOptions = field(default_factory=MendOptions)
    strain: StrainOptions = field(default_factory=StrainOptions)
    relief: ReliefOptions = field(default_factory=ReliefOptions)
    approach: ApproachOptions = field(default_factory=ApproachOptions)
    share: ShareOptions = field(default_factory=ShareOptions)
    release: ReleaseOptions = field(default_factory=ReleaseOptions)
    lift: LiftOptions = field(default_factory=LiftOptions)
    sunken: SunkenOptions = field(default_factory=SunkenOptions)
    separation: SeparationOptions = field(default_factory=SeparationOptions)
    full: FullOptions = field(default_factory=FullOptions)
    paper: PaperOptions | None = None


def poses_at_once(options: RepairOptions, device: str, *, paper: PaperOptions | None = None) -> int:
    """Return how many poses are best solved at once: a GPU has room for many by the paper."""
    if options.method == "full" or device == "cpu":
        return 1
    from dtrepair.repair.paper.gpu_descent import GpuOptions

    return GpuOptions.batch if paper is None else paper.gpu.batch


def repair_poses(
    scene: Scene,
    meshes: WeldedMeshes,
    poses: Sequence[Sequence[Any]],
    *,
    options: IndependentOptions = IndependentOptions(),
) -> list[list[RepairResult]]:
    """Return the results of poses (V, 3) of each body, all in one space and length unit.

    Raises:
        ValueError: wrong shapes, numbers that are not finite.
    """
    opened = [detected(scene, gathered(scene, points)) for points in poses]
    start = time.perf_counter()
    wanted = [k for k, pose in enumerate(opened) if pose.wrong or scene.options.clearance > 0.0]
    chosen = [opened[k] for k in wanted]
    found = dict(zip(wanted, _solved(scene, meshes, chosen, options), strict=True))
    seconds = (time.perf_counter() - start) / max(len(wanted), 1)
    unsolved = [(pose.centred, Solved(pose.centred)) for pose in opened]
    return [
        _closed(
            scene, meshes, pose, *found.get(k, unsolved[k]), seconds if k in found else 0.0, options
        )
        for k, pose in enumerate(opened)
    ]


def _solved(
    scene: Scene, meshes: WeldedMeshes, opened: list[OpenedPose], options: IndependentOptions
) -> list[tuple[FloatArray, Solved]]:
    """Return a pose (V, 3) and how it was found; those of one welded mesh are solved at once."""
    starts = [_start(scene, pose, options) for pose in opened]
    of_pose = [meshes([pose.sewn]) for pose in opened]
    found: dict[int, tuple[FloatArray, Solved]] = {}
    for mesh in {id(mesh): mesh for mesh in of_pose}.values():
        own = [k for k, other in enumerate(of_pose) if other is mesh]
        poses = [_Pose(scene, mesh, opened[k], starts[k], options) for k in own]
        separated = [pose.separated(pose.start, pose.opened.pairs) for pose in poses]
        for pose, k, led, solved in zip(poses, own, separated, mesh.solve(separated), strict=True):
            found[k] = solved if len(scene.bodies) == 1 else pose.improved(solved, led)
    return [found[k] for k in range(len(opened))]


def solved_pose(
    scene: Scene, meshes: WeldedMeshes, opened: OpenedPose, *, options: IndependentOptions
) -> FloatArray:
    """Return what is found (V, 3) for a pose on its own; it may be strained."""
    points = _solved(scene, meshes, [opened], options)[0][0]
    pairs_of = partial(scene.pairs, weld=opened.weld)
    found = bounded_pose(
        scene, opened, Judged(points), pairs_of(points), pairs_of, options=options.share
    )
    mesh, numbers = meshes([opened.sewn]), options.approach
    better = bounded_approach(scene, mesh, opened, found, pairs_of, options=numbers)
    return points if better is found else better[0].points


def _start(scene: Scene, pose: OpenedPose, options: IndependentOptions) -> FloatArray:
    """Return a pose (V, 3) with its enclosed and sunken parts led out, and its layers lifted."""
    start = pose.centred
    if len(pose.enclosed):
        start = released(scene, start, not_worn(scene, pose.enclosed), options=options.release)
    met, one = parts_that_meet(scene, pose.pairs, pose.enclosed), np.zeros(1)
    frames = raised_frames(scene, start[None], [pose.pairs], one, options=options.sunken)
    lifted: FloatArray = lifted_frames(scene, frames, [met], one, options=options.lift)[0]
    return lifted


class _Pose(NamedTuple):
    """A pose on its way: as it came, and the start (V, 3) with its enclosed parts led out."""

    scene: Scene
    mesh: WeldedMesh
    opened: OpenedPose
    start: FloatArray
    options: IndependentOptions

    def separated(
        self,
        points: FloatArray,
        pairs: IntArray,
        sheets: frozenset[int] = frozenset(),
        tangled: frozenset[tuple[int, int]] = frozenset(),
    ) -> FloatArray:
        """Return a pose (V, 3) with `pairs` (K, 2) whose penetrating bodies are led apart."""
        frames = separated_frames(
            self.scene,
            self.mesh,
            points[None],
            [pairs],
            np.zeros(1),
            sheets=sheets,
            tangled=tangled,
            options=self.options.separation,
        )
        pose: FloatArray = frames[0]
        return pose

    def improved(
        self, found: tuple[FloatArray, Solved], separated: FloatArray
    ) -> tuple[FloatArray, Solved]:
        """Return what was found; where it is torn or has pairs, with sheets led apart if better.

        Bodies that are not concerned, nor meet those that are, stay where they were found.
        """
        scene, pairs = self.scene, self.opened.pairs
        judged = self._judged(found[0])
        torn = judged.stretched >= self.options.torn
        if torn.any():
            torn &= ~squeezed(self.mesh, found[0], torn, options=self.options)
        troubled = {*np.flatnonzero(torn).tolist(), *scene.body_of[judged.pairs].ravel().tolist()}
        if not troubled:
            return found
        met, counts = contact_counts(scene.body_of, pairs)
        concerned = np.isin(met, list(troubled)).any(axis=1)
        fresh = [*troubled, *met[concerned].ravel()]
        again = np.isin(scene.body_of_vertex, fresh)
        other = self.separated(
            np.where(again[:, None], self.start, found[0]),
            pairs[np.isin(scene.body_of[pairs], fresh).any(axis=1)],
            frozenset(troubled),
            self._tangled((met[concerned], counts[concerned]), judged.pairs, torn=bool(torn.any())),
        )
        if np.array_equal(other[again], separated[again]):
            return found
        solved = self.mesh.solve([other])[0]
        return solved if self._judged(solved[0]).rank < judged.rank else found

    def _tangled(
        self, met: tuple[IntArray, IntArray], left: IntArray, *, torn: bool
    ) -> frozenset[tuple[int, int]]:
        """Return which bodies that met are tangled, by the pairs (K, 2) that are left.

        What was torn but came apart is tangled only where next to nothing is inside of the other.
        """
        options = self.options.separation.untangling
        still = contact_counts(self.scene.body_of, self.opened.pairs if torn else left)
        stuck = tangled_contacts([met], [still], options=options)
        return frozenset(both for both in stuck if len(left) or self._passes_through(*both))

    def _passes_through(self, first: int, second: int) -> bool:
        """Return whether at most a small fraction of either body is inside of the other."""
        options = self.options.separation
        one, other = BodyShape(self.scene, first), BodyShape(self.scene, second)
        inside = [
            find_inside(self.start, *both, options=options.penetration)
            for both in ((one, other), (other, one))
        ]
        return max(found.fraction for found in inside) < options.fraction

    def _judged(self, points: FloatArray) -> _Judged:
        """Return what a pose (V, 3) is worth beside the start."""
        scene, mesh, start = self.scene, self.mesh, self.start
        surface = mesh.surface
        old, new = start[mesh.kept], points[mesh.kept]
        body_of_edge = surface.body_of_vertex[surface.edges[:, 0]]
        parts = np.split(surface.edges, np.searchsorted(body_of_edge, range(1, len(scene.bodies))))
        own = [slice(*ends) for ends in pairwise(scene.vertex_starts)]
        return _Judged(
            scene.pairs(points, scene.weld(points)),
            np.array([edge_log_ratio(old, new, edges) for edges in parts]),
            np.array([displacements(start[part], points[part]).mean() for part in own]),
        )


class _Judged(NamedTuple):
    """Pairs (K, 2) of a pose; change of the edges, and mean motion, of each body (B,)."""

    pairs: IntArray
    stretched: FloatArray
    moved: FloatArray

    @property
    def rank(self) -> tuple[int, float]:
        """Pairs first, then what the worst body changed and moved: smaller is better."""
        return len(self.pairs), float((self.stretched + self.moved).max())


def squeezed(
    mesh: WeldedMesh,
    points: FloatArray,
    torn: BoolArray,
    *,
    options: IndependentOptions = IndependentOptions(),
) -> BoolArray:
    """Return which bodies (B,) are pressed from many sides in a pose (V, 3).

    What is near is measured by the smallest of the `torn` (B,) bodies.
    """
    surface = mesh.surface
    bodies = [surface.bodies[body] for body in np.flatnonzero(torn)]
    smallest = min(extent(points[mesh.kept[own.start : own.stop]]) for own in bodies)
    written = points[mesh.kept].astype(np.float32)
    close = close_pairs(surface.detector, written, options.pressed * smallest)
    sides = contact_counts(surface.body_of, close)[0].ravel()
    return np.bincount(sides, minlength=len(torn)) >= options.sides


def _closed(
    scene: Scene,
    meshes: WeldedMeshes,
    pose: OpenedPose,
    final: FloatArray,
    solved: Solved,
    seconds: float,
    options: IndependentOptions,
) -> list[RepairResult]:
    """Return the results of each body; what is no better than the input leaves it as it was."""
    start = time.perf_counter()

    def pairs_of(points: FloatArray) -> IntArray:
        # Vertices that only happened to coincide in the input are two in the result.
        return scene.pairs(points, scene.weld(points))

    if final is not pose.centred:
        mesh = meshes([pose.sewn])
        (final,) = relieved_poses(scene, mesh, [pose], [final], options=options.relief)
    pairs = pose.pairs if final is pose.centred else pairs_of(final)
    bounded = bounded_pose(scene, pose, Judged(final), pairs, pairs_of, options=options.share)
    if final is not pose.centred:
        numbers = options.approach
        bounded = bounded_approach(scene, mesh, pose, bounded, pairs_of, options=numbers)
    judged, pairs = bounded
    if judged.lowered:
        judged, pairs = mended(
            scene,
            meshes([pose.sewn]),
            pose.centred,
            judged,
            pairs,
            pairs_of,
            step=options.mend_step,
            options=options.mend,
        )
    found = kept(scene, pose, judged.points, pairs)
    spent = {"detect": pose.seconds, "solve": seconds + time.perf_counter() - start}
    return results_of(scene, pose, found, solved, spent, judged)
