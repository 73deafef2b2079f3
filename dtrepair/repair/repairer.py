"""Repair of poses of one body or of several bodies together: check, solve, verify, report."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtrepair.device import DeviceQueue, resolve_device
from dtrepair.intersect.detector import Detector, triangle_count
from dtrepair.intersect.ignored import of_ignored_bodies
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    as_given,
    as_mesh,
    as_numpy,
    as_points,
    diagonal,
    pair_keys,
    unique_edges,
    weld_map,
)
from dtrepair.numerics.metrics import displacements
from dtrepair.repair.clip.animation import AnimationRepairer, animate
from dtrepair.repair.independent import repair_poses
from dtrepair.repair.options import Count, RepairOptions, RepairResult, Solved, Status
from dtrepair.repair.scene.bodies import (
    Body,
    about_centre,
    checked_ignored,
    direction_of,
    mobility_of,
)
from dtrepair.repair.scene.diagnosis import contacts_left, cures, deformed, enclosed_left
from dtrepair.repair.scene.welded_mesh import System
from dtrepair.repair.separation.release import bodies_of_parts
from dtrepair.repair.surface.containment import Enclosures
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from dtrepair.wording import counted

# Largest clearance, part of the diagonal: with a larger one everything is close to everything.
WIDEST = 0.05


class SceneRepairer:
    """Repairs poses of several bodies together; built once per set of bodies.

    Every body has its own diffusion operator (Jang et al. 2025, section 7.5.2); tree, operators
    and factors come from the rest poses and serve every pose. Contacts between the bodies of a
    pair in `ignore`, pairs of indices, are neither repaired nor counted; (k, k) are those of a
    body with itself.

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
    ) -> None:
        if not bodies:
            raise ValueError("bodies should hold at least one body, got none")
        for body in bodies:
            if body.diffusion is not None and not 0.0 < body.diffusion < np.inf:
                raise ValueError(
                    f"diffusion should be positive and finite, got {body.diffusion}: "
                    "None takes that of the options"
                )
        self.options = options or RepairOptions()
        self.device = resolve_device(device)
        # One for all systems: PyTorch has few streams, and gives them out again.
        self.queue = None if self.device == "cpu" else DeviceQueue(self.device)
        self.bodies = tuple(bodies)
        self.ignored = checked_ignored(ignore, len(bodies))
        meshes = [as_mesh(body.rest, body.faces) for body in bodies]
        self._vertices = np.cumsum([0, *(len(points) for points, _ in meshes)])
        self._triangles = np.cumsum([0, *(len(faces) for _, faces in meshes)])
        self._rest = np.concatenate([points for points, _ in meshes])
        most = WIDEST * diagonal(self._rest)
        if self.options.clearance > most > 0.0:
            raise ValueError(
                f"clearance should be at most {most:.4g}, {WIDEST:.0%} of the diagonal of the rest "
                f"poses, got {self.options.clearance:.4g}"
            )
        shifted = [faces + start for (_, faces), start in zip(meshes, self._vertices, strict=False)]
        self._faces = np.concatenate(shifted).astype(np.int32)
        self._body_of = np.repeat(np.arange(len(bodies)), np.diff(self._triangles))
        self._mobility = np.concatenate(
            [mobility_of(b, len(p)) for b, (p, _) in zip(bodies, meshes, strict=True)]
        )
        self._direction = np.concatenate(
            [direction_of(b, len(p)) for b, (p, _) in zip(bodies, meshes, strict=True)]
        )
        self._systems: dict[bytes, System] = {}

    @cached_property
    def detector(self) -> Detector:
        """Detector of all bodies in one mesh, built on their rest poses."""
        return Detector(about_centre(self._rest)[0], self._faces)

    @cached_property
    def rest_weld(self) -> IntArray:
        """Vertices (V,) of one body at one position of the rest count as one."""
        return self._weld(about_centre(self._rest)[0])

    @cached_property
    def body_of_vertex(self) -> IntArray:
        """The body of each vertex (V,)."""
        return np.repeat(np.arange(len(self.bodies)), np.diff(self._vertices)).astype(np.int32)

    @cached_property
    def edges_of_bodies(self) -> list[IntArray]:
        """Edges (E, 2) of each body, numbered within it."""
        ends = zip(pairwise(self._triangles), self._vertices, strict=False)
        return [unique_edges(self._faces[a:b] - start) for (a, b), start in ends]

    @cached_property
    def enclosures(self) -> Enclosures:
        """Finds what lies wholly inside what."""
        return Enclosures(self._rest, self.rest_weld[self._faces])

    @cached_property
    def rigid(self) -> RigidBodies:
        """The bodies that move as a whole only."""
        ranges = zip(pairwise(self._vertices.tolist()), self.bodies, strict=True)
        chosen = [own for own, body in ranges if body.rigid]
        return RigidBodies(chosen, np.ones(len(self._rest)))

    @cached_property
    def rest_intersections(self) -> int:
        """Number of intersecting triangles of the rest poses themselves, mode respected."""
        return triangle_count(
            self._pairs(about_centre(self._rest)[0], self._weld(about_centre(self._rest)[0]))
        )

    @cached_property
    def animator(self) -> AnimationRepairer:
        """Repairs frames together: `animator.stream(frames)`."""
        return AnimationRepairer(self)

    def __call__(self, points: Sequence[Any]) -> list[RepairResult]:
        """Repair one pose (V, 3) of each body, all in one space and length unit.

        ValueError: wrong shapes, numbers that are not finite.
        """
        return self.batch([points])[0]

    def batch(self, poses: Sequence[Sequence[Any]]) -> list[list[RepairResult]]:
        """Repair many poses, each for itself: on a GPU `poses_at_once` are solved at once."""
        return repair_poses(self, poses)

    @property
    def poses_at_once(self) -> int:
        """How many poses are best given to `batch`."""
        if self.options.method == "full" or self.device == "cpu":
            return 1
        from dtrepair.repair.paper.gpu_descent import BATCH

        return BATCH

    def _gather(self, points: Sequence[Any]) -> FloatArray:
        if len(points) != len(self.bodies):
            raise ValueError(f"points should hold {len(self.bodies)} poses, got {len(points)}")
        counts = np.diff(self._vertices)
        return np.concatenate(
            [
                as_points(as_numpy(pose), int(count))
                for pose, count in zip(points, counts, strict=True)
            ]
        )

    def _weld(self, points: FloatArray) -> IntArray:
        """Vertices of one body at one float32 position of `points` count as one (V,)."""
        with np.errstate(over="ignore"):  # the detector tells what is beyond float32
            parts = [
                weld_map(points[a:b]) + a
                for a, b in zip(self._vertices[:-1], self._vertices[1:], strict=True)
            ]
        return np.concatenate(parts).astype(np.int32)

    def _pairs(self, points: FloatArray, weld: IntArray) -> IntArray:
        pairs = self.detector(points, weld=weld)
        if self.options.mode != "both":
            inter = self._body_of[pairs[:, 0]] != self._body_of[pairs[:, 1]]
            pairs = pairs[inter == (self.options.mode == "inter")]
        return pairs[~of_ignored_bodies(self._body_of[pairs], self.ignored)]

    def _result(
        self,
        index: int,
        given: Any,
        original: FloatArray,
        repaired: FloatArray,
        before: IntArray,
        after: IntArray,
        solved: Solved,
        seconds: dict[str, float],
        caught: IntArray | None = None,
    ) -> RepairResult:
        own = slice(self._vertices[index], self._vertices[index + 1])
        counts = [self._count(pairs, index) for pairs in (before, after)]
        moved = displacements(original[own], repaired[own])
        status = _status(*counts)
        inside = "" if caught is None else self._inside(caught, index)
        if inside and status is Status.CLEAN:
            status = Status.IMPROVED if counts[0].pairs else Status.UNCHANGED
        return RepairResult(
            points=as_given(repaired[own], given),
            before=counts[0],
            after=counts[1],
            iterations=solved.iterations,
            status=status,
            message=inside
            or self._message(index, status, after, solved)
            or deformed(self, index, original[own], repaired[own]),
            displacement_max=float(moved.max(initial=0.0)),
            displacement_mean=float(moved.mean()) if len(moved) else 0.0,
            stages=tuple(solved.stages),
            seconds=seconds,
        )

    def _inside(self, caught: IntArray, index: int) -> str:
        """What lies inside what, where it concerns a body; empty where nothing does."""
        return enclosed_left(self, caught[(bodies_of_parts(self, caught) == index).any(axis=1)])

    def _message(self, index: int, status: Status, after: IntArray, solved: Solved) -> str:
        if status is Status.CLEAN and solved.left:
            return f"{counted(solved.left, 'pair')} closer than the clearance"
        if len(after) and self.options.rest_contacts == "leave":
            at_rest = int(np.isin(pair_keys(after), self._rest_keys).sum())
            if at_rest == len(after):
                return (
                    f"what is left intersects in the rest pose as well ({counted(at_rest, 'pair')})"
                )
        if status in (Status.IMPROVED, Status.UNCHANGED):
            own = (self._body_of[after] == index).any(axis=1)
            return f"{contacts_left(self, after[own])}: {status.meaning}: {cures(self, after[own])}"
        return status.meaning

    @cached_property
    def _rest_keys(self) -> NDArray[np.int64]:
        rest = about_centre(self._rest)[0]
        return pair_keys(self._pairs(rest, self._weld(rest)))

    def _count(self, pairs: IntArray, index: int) -> Count:
        owner = self._body_of[pairs]
        own = (owner == index).any(axis=1)
        triangles = np.unique(pairs)
        inter = int((own & (owner[:, 0] != owner[:, 1])).sum())
        return Count(int((self._body_of[triangles] == index).sum()), int(own.sum()), inter)


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
        all processors. ValueError for wrong frames or times.
        """
        return animate(self._scene, points, times, jobs)


def repair_mesh(
    points: Any, faces: ArrayLike, *, options: RepairOptions | None = None
) -> RepairResult:
    """Repair a single mesh (V, 3), (F, 3) that has no rest pose: it is its own."""
    return Repairer(as_numpy(points), faces, options=options)(points)


def _status(before: Count, after: Count) -> Status:
    if after.pairs == 0:
        return Status.CLEAN
    return Status.IMPROVED if after.pairs < before.pairs else Status.UNCHANGED
