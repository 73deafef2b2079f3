"""Repair of poses of one body or of several bodies together, alone or as the frames of a clip."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.device import DeviceQueue, resolve_device
from dtrepair.diagnosis import Status, Strain
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import as_numpy, lengths
from dtrepair.numerics.threads import one_thread
from dtrepair.repair.independent import repair_poses
from dtrepair.repair.independent_options import IndependentOptions, poses_at_once
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.relief.other_ways import OtherWayOptions
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.bodies import Body, about_centre
from dtrepair.repair.scene.bounds import strain_of
from dtrepair.repair.scene.diagnosis import strains_of
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.props import SHAPE
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.separation.free_props import with_free_props
from dtrepair.repair.solution_cache import Memory, remembering

if TYPE_CHECKING:
    # The stages of clips are loaded for clips only.
    from dtrepair.repair.clip.clip_options import ClipOptions
    from dtrepair.repair.clip.clip_repairer import ClipRepairer
    from dtrepair.repair.clip.window_method import MakeMethod


class SceneRepairer:
    """Repairs poses of several bodies together; built once per set of bodies.

    Every body has its own diffusion operator (Jang et al. 2025, section 7.5.2); tree, operators
    and factors come from the rest poses and serve every pose.

    Args:
        bodies: The bodies, in one space and length unit.
        options: Choices; default: `RepairOptions()`.
        device: "cpu", "cuda", "cuda:N" or "auto": a GPU for the method "paper", where there is one.
        ignore: Pairs of bodies, by index, whose contacts are neither repaired nor counted; (k, k)
            are those of a body with itself.
        clip: Numbers of the stages of clips and single poses, and the sizes of windows; default:
            `ClipOptions()`.
        references: Poses that show which contacts were modelled; see `Scene`.
        layer_poses: Poses that show which part lies over which; default: the rest.

    Raises:
        ValueError: bodies, options or devices that cannot be used.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        *,
        options: RepairOptions | None = None,
        device: str = "cpu",
        ignore: Sequence[tuple[int, int]] = (),
        clip: ClipOptions | None = None,
        references: Sequence[Reference] = (),
        layer_poses: Sequence[Reference] = (),
    ) -> None:
        self._clip = clip
        self._ways = OtherWayOptions() if clip is None else clip.ways
        self._independent = numbers = IndependentOptions() if clip is None else clip.independent
        choices = options or RepairOptions()
        # The default method works on the CPU: looking for a GPU would only take a context there.
        idle = device == "auto" and choices.method == "full"
        self.device = "cpu" if idle else resolve_device(device)
        scene = make_scene(
            bodies,
            choices,
            ignore,
            references,
            layer_poses,
            strain=numbers.strain,
            # The default method forks, which no context of a GPU survives.
            device=self.device if choices.method == "paper" else "cpu",
        )
        self.scene = with_free_props(scene, options=numbers.separation.worn)
        queue = None if self.device == "cpu" else DeviceQueue(self.device)
        self.meshes = WeldedMeshes(self.scene, queue, full=numbers.full, paper=numbers.paper)
        # How many poses are best given to `batch`.
        self.poses_at_once = poses_at_once(self.scene.options, self.device, paper=numbers.paper)

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies."""
        return self.scene.bodies

    @property
    def options(self) -> RepairOptions:
        """The choices."""
        return self.scene.options

    @property
    def ignored(self) -> tuple[tuple[int, int], ...]:
        """Pairs (i, j), i <= j, of bodies whose contacts do not count."""
        return self.scene.ignored

    @property
    def rest_intersections(self) -> int:
        """Number of intersecting triangles of the rest poses themselves, mode respected."""
        return self.scene.rest_intersections

    def with_room(self, room: float) -> SceneRepairer:
        """Return a repairer of single poses whose repaired contacts keep a distance, length units.

        What has none keeps every bit. Where a clearance is asked for that is the room, and the
        published method keeps none.
        """
        if self.options.clearance or self.options.method == "paper":
            return self
        numbers = replace(self._independent, room=True)
        return self._changed(numbers, f"room {room}", clearance=room)

    def untightened(self) -> SceneRepairer:
        """Return a repairer that does not tighten, as the published method never does."""
        if self.options.method == "paper" or self.options.tighten == 0:
            return self
        return self._changed(self._independent, "untightened", tighten=0)

    def _changed(self, numbers: IndependentOptions, way: str, **changes: Any) -> SceneRepairer:
        """Return a repairer with other options that nothing made of the rest poses depends on."""
        other = copy(self)
        vars(other).pop("animator", None)
        other._independent, other.meshes = numbers, self.meshes.with_options(way, **changes)
        other.scene = other.meshes.scene
        return other

    @cached_property
    def animator(self) -> ClipRepairer:
        """Repairs frames together: `animator.stream(frames)`."""
        return self.make_animator()

    def make_animator(self, memory: Memory | None = None) -> ClipRepairer:
        """Return a repairer of frames that keeps solved windows in a memory, and looks them up."""
        from dtrepair.repair.clip.clip_options import ClipOptions
        from dtrepair.repair.clip.clip_repairer import ClipRepairer, window_method

        numbers = self._clip or ClipOptions()
        make_method: MakeMethod = partial(window_method, self.options, numbers)
        if memory is not None:
            make_method = remembering(make_method, memory)
        return ClipRepairer(
            self.scene,
            self.meshes,
            options=numbers,
            make_method=make_method,
            poses_at_once=self.poses_at_once,
        )

    def __call__(self, points: Sequence[Any]) -> list[RepairResult]:
        """Repair one pose (V, 3) of each body, all in one space and length unit.

        ValueError: wrong shapes, numbers that are not finite.
        """
        return self.batch([points])[0]

    def strains(
        self, before: Sequence[Any], after: Sequence[Any], *, loosely: bool = False
    ) -> tuple[Strain, ...]:
        """Return what a correction of poses (V, 3) of each body strains beyond the bounds.

        loosely: by those that hold where something would be left else.
        """
        given = self.scene.gather(before)
        centred, centre = about_centre(given)
        excess = strain_of(self.scene, centred, self.scene.gather(after) - centre, loosely=loosely)
        bodies = range(len(self.bodies))
        return tuple(s for body in bodies for s in strains_of(self.scene, body, given, excess))

    @one_thread()
    def batch(self, poses: Sequence[Sequence[Any]]) -> list[list[RepairResult]]:
        """Repair many poses, each for itself: on a GPU `poses_at_once` are solved at once."""
        numbers, first = self._independent, self.meshes.with_props
        results = repair_poses(first.scene, first, poses, options=numbers)
        for index, found in enumerate(results):
            if first is not self.meshes:
                results[index] = self._bent_if_better(poses[index], found)
            for meshes in self._otherwise(poses[index], results[index]):
                (other,) = repair_poses(meshes.scene, meshes, [poses[index]], options=numbers)
                if _left(other) < _left(results[index]):
                    results[index] = other
        return results

    def _bent_if_better(
        self, points: Sequence[Any], found: list[RepairResult]
    ) -> list[RepairResult]:
        """Return a pose with props that bend, where rigid ones leave more, or go much farther."""
        left, far = _left(found), self._farthest(points, found)
        if not left and far <= self._ways.far:
            return found
        numbers = self._independent
        (other,) = repair_poses(self.scene, self.meshes, [points], options=numbers)
        less, nearer = _left(other), self._ways.much_farther(far, self._farthest(points, other))
        return other if less < left or (less == left and nearer) else found

    def _farthest(self, points: Sequence[Any], found: Sequence[RepairResult]) -> float:
        """Return how far a vertex of a pose moves at most, diagonals."""
        before, after = (self.scene.gather(own) for own in (points, [r.points for r in found]))
        return float(lengths(after - before).max()) / self.scene.scale.diagonal(before)

    def _otherwise(
        self, points: Sequence[Any], found: Sequence[RepairResult]
    ) -> Iterator[WeldedMeshes]:
        """Yield other ways for a strained pose: without directions, with what is carried rigid."""
        if all(result.status is not Status.STRAINED for result in found):
            return
        kinds = [{own.kind for own in result.diagnosis.strains} for result in found]
        bent = [body for body, own in enumerate(kinds) if not own.isdisjoint(SHAPE)]
        yield from self.meshes.otherwise([bent], [about_centre(self.scene.gather(points))[0]])


def _left(results: Sequence[RepairResult]) -> int:
    """Return how many pairs all bodies of a pose have together, twice.

    Each has those with others among its own, which are counted once for either body.
    """
    return sum(2 * own.after.pairs - own.after.inter_pairs for own in results)


class Repairer:
    """Repairs poses of one mesh; built once per topology.

    Args:
        rest: Rest positions (V, 3), any length unit, of the same mesh as the poses.
        faces: Triangles (F, 3).
        options: Choices; default: `RepairOptions()`.
        device: "cpu", "cuda", "cuda:N" or "auto".
        pin: 0 free to 1 fixed for each vertex (V,); fixed vertices come back bit-identical.
        direction: Preferred direction of the repair (V, 3), zero rows where none.

    Raises:
        ValueError: shapes, numbers, options or devices that cannot be used.
    """

    def __init__(
        self,
        rest: ArrayLike,
        faces: ArrayLike,
        *,
        options: RepairOptions | None = None,
        device: str = "cpu",
        pin: ArrayLike | None = None,
        direction: ArrayLike | None = None,
    ) -> None:
        body = Body(rest, faces, pin=pin, direction=direction)
        self._scene = SceneRepairer([body], options=options, device=device)

    @property
    def rest_intersections(self) -> int:
        """Number of intersecting triangles of the rest pose itself."""
        return self._scene.rest_intersections

    def __call__(self, points: Any) -> RepairResult:
        """Repair a pose (V, 3) in the length unit of the rest; ValueError for wrong poses."""
        return self._scene([points])[0]

    def animation(
        self, points: Any, *, times: ArrayLike | None = None, jobs: int | None = None
    ) -> list[RepairResult]:
        """Repair frames (T, V, 3) together: clean, close to the input, and steady in time.

        times: time of each frame (T,), increasing; default: one apart. jobs: workers; default:
        all processors. ValueError for wrong frames or times, before any frame is repaired; it
        names the first wrong frame.
        """
        count, shape = len(points), np.shape(points[0]) if len(points) else (0, 3)
        if len(shape) != 2:
            raise ValueError(f"points should be frames (T, V, 3), got frames of shape {shape}")
        stamps = np.arange(count) if times is None else np.asarray(times, dtype=np.float64)
        if stamps.shape != (count,):
            raise ValueError(
                f"times should hold one time for each of {count} frames, got {stamps.shape}"
            )
        self._check_frames(points)
        frames = ((float(stamp), [points[index]]) for index, stamp in enumerate(stamps))
        return [frame.results[0] for frame in self._scene.animator.stream(frames, jobs=jobs)]

    def _check_frames(self, points: Any) -> None:
        """Refuse frames (T, V, 3) that cannot be used, with the number of the first; ValueError."""
        for index in range(len(points)):
            try:
                self._scene.scene.gather([points[index]])
            except ValueError as error:
                raise ValueError(
                    f"frame {index} of {len(points)}, counted from 0: {error}"
                ) from None


def repair_mesh(
    points: Any, faces: ArrayLike, *, options: RepairOptions | None = None
) -> RepairResult:
    """Repair a single mesh (V, 3), (F, 3) that has no rest pose: it is its own."""
    return Repairer(as_numpy(points), faces, options=options)(points)
