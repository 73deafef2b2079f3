"""The mesh that is solved for poses of a scene: duplicates that belong together are one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import DeviceQueue
from dtrepair.numerics.geometry import FloatArray, IntArray, differing
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.result import Solved
from dtrepair.repair.scene.props import as_wholes, props_among, with_rigid
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.sub_scene import (
    OuterSides,
    Part,
    SubScene,
    inner_parts,
    outer_sides,
    sub_scene,
)
from dtrepair.repair.surface.surface import BodyRange, Surface, SurfaceOptions

if TYPE_CHECKING:
    # PyTorch is loaded for the published method only.
    from dtrepair.repair.paper.method import PaperOptions


class WeldedMesh:
    """All bodies of a scene in one surface, and the method that repairs single poses of it.

    Args:
        scene: The bodies and options.
        together: For each vertex (V,) the one that stands for it.
        queue: Where work on a GPU is queued; None on the CPU.
        full: Numbers of the full method.
        paper: Numbers of the published method; default: `PaperOptions()`.
        surface: Numbers of the surface.
        way: What sets it apart from other meshes of the same bodies, see `WeldedMeshes`.
    """

    def __init__(
        self,
        scene: Scene,
        together: IntArray,
        queue: DeviceQueue | None = None,
        *,
        way: str = "",
        full: FullOptions = FullOptions(),
        paper: PaperOptions | None = None,
        surface: SurfaceOptions = SurfaceOptions(),
    ) -> None:
        self.way = way
        self.kept, self.place = np.unique(together, return_inverse=True)
        self.surface = _surface(scene, self.kept, self.place, surface)
        # In units of the surface's size.
        limit = scene.options.maximum_displacement
        self.farthest = None if limit is None else limit / self.surface.size
        self.clearance = scene.options.clearance / self.surface.size
        self._solve = self._method(scene.options, queue, full, paper)

    def _method(
        self,
        options: RepairOptions,
        queue: DeviceQueue | None,
        full: FullOptions,
        paper: PaperOptions | None,
    ) -> Callable[[Sequence[FloatArray]], list[Solved]]:
        """Return the function that repairs poses of the surface, in units of its size."""
        if options.method == "paper":
            from dtrepair.repair.paper.method import PaperMethod, PaperOptions

            numbers = paper or PaperOptions()
            return PaperMethod(self.surface, options, queue=queue, options=numbers).batch
        method = FullMethod(
            self.surface,
            rounds=options.tighten,
            farthest=self.farthest,
            skip=options.skip,
            effort=options.effort,
            options=full,
        )
        return lambda poses: [method(pose) for pose in poses]

    def on_way(self, way: str) -> WeldedMesh:
        """Return the same mesh, set apart from others by another way."""
        other = copy(self)
        other.way = f"{self.way}/{way}"
        return other

    def solve(self, poses: Sequence[FloatArray]) -> list[tuple[FloatArray, Solved]]:
        """Return repaired poses (V, 3); vertices that stayed where they were keep every bit."""
        units = [self.reduced(points) for points in poses]
        return [
            (self.expanded(points, unit, solved.points), solved)
            for points, unit, solved in zip(poses, units, self._solve(units), strict=True)
        ]

    def reduced(self, points: FloatArray) -> FloatArray:
        """Return points (V, 3) of the scene as those of the surface, in units of its size."""
        return points[self.kept] / self.surface.size

    def expanded(self, points: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
        """Return a solved pose of the surface as points (V, 3) of the scene.

        `before` is what `points` were reduced to: vertices that stayed there keep every bit.
        """
        after = self.surface.rigid.fitted(before, after)
        stayed = ~differing(after, before)[self.place]
        return np.where(stayed[:, None], points, (after * self.surface.size)[self.place])


def _surface(
    scene: Scene,
    kept: NDArray[np.integer],
    place: NDArray[np.integer],
    numbers: SurfaceOptions,
) -> Surface:
    """Return the surface of the vertices that are kept; each of the scene is at its place there."""
    faces = place[scene.faces].astype(np.int32)
    # A triangle between two vertices that became one has no area and takes no part.
    solid = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
    solid &= faces[:, 2] != faces[:, 0]
    triangles = np.flatnonzero(solid).astype(np.int32)
    starts = np.searchsorted(kept, scene.vertex_starts)
    options, attachments = scene.options, scene.held
    bodies = [
        BodyRange(int(a), int(b), body.diffusion or options.diffusion, rigid=body.rigid)
        for a, b, body in zip(starts[:-1], starts[1:], scene.bodies, strict=True)
    ]
    mobility = np.ones(len(kept))
    np.minimum.at(mobility, place, scene.mobility)
    covering = scene.covering and scene.covering.of_vertices(kept, place)
    if covering is not None:
        mobility *= options.inner_mobility**covering.depth
    return Surface(
        scene.centred_rest[kept],
        faces[solid],
        bodies=bodies,
        body_of=scene.body_of[triangles],
        mobility=mobility,
        mode=options.mode,
        leave_rest=options.rest_contacts == "leave",
        ignored=scene.ignored,
        direction=scene.direction[kept] if scene.direction.any() else None,
        options=numbers,
        attachments=attachments and attachments.of_triangles(triangles, place),
        covering=covering,
        scale=scene.scale.among(kept),
    )


class PartMeshes(NamedTuple, Generic[Part]):
    """Parts of a scene, and the welded meshes of them."""

    parts: Part
    meshes: WeldedMeshes


class WeldedMeshes:
    """The welded meshes of a scene, each built once.

    Args:
        scene: The bodies and options.
        queue: Where work on a GPU is queued, one for all meshes: PyTorch has few streams, and
            gives them out again. None on the CPU.
        full: Numbers of the full method.
        paper: Numbers of the published method; default: `PaperOptions()`.
        surface: Numbers of the surfaces.
        way: What sets the meshes apart from those of the whole scene: bodies, props that are rigid.
    """

    def __init__(
        self,
        scene: Scene,
        queue: DeviceQueue | None = None,
        *,
        way: str = "",
        full: FullOptions = FullOptions(),
        paper: PaperOptions | None = None,
        surface: SurfaceOptions = SurfaceOptions(),
    ) -> None:
        self.scene, self.way, self._queue = scene, way, queue
        self._full, self._paper, self._surface = full, paper, surface
        self._known: dict[bytes, WeldedMesh] = {}
        self._ways: dict[str, WeldedMeshes] = {}
        self._groups: dict[tuple[int, ...], PartMeshes[SubScene]] = {}

    def _of(self, scene: Scene, way: str, surface: SurfaceOptions | None = None) -> WeldedMeshes:
        """Return the meshes of another scene, by the full method on the CPU."""
        numbers = surface or self._surface
        return WeldedMeshes(scene, full=self._full, surface=numbers, way=f"{self.way}/{way}")

    def with_options(self, way: str, **changes: Any) -> WeldedMeshes:
        """Return the meshes with options that no attachment depends on; each way has its own."""
        if way not in self._ways:
            options = replace(self.scene.options, **changes)
            self._ways[way] = self._of(self.scene.changed(options=options), way)
        return self._ways[way]

    @cached_property
    def without_clearance(self) -> WeldedMeshes:
        """The meshes of a scene that asks for none: contacts are opened when all else is done."""
        if self.scene.options.clearance == 0.0:
            return self
        return self.with_options("without clearance", clearance=0.0)

    @cached_property
    def undirected(self) -> WeldedMeshes | None:
        """The meshes without preferred directions; None where there are none to be left out.

        A direction is a wish: where it strains the shape, the way that does not is better.
        """
        if self.scene.options.method == "paper" or not self.scene.direction.any():
            return None
        scene = replace(self.scene, direction=np.zeros_like(self.scene.direction))
        return self._of(scene, "undirected")

    @cached_property
    def creased(self) -> tuple[WeldedMeshes, ...]:
        """Other ways: attached parts share no creases, or all do, see `Partners`."""
        numbers = self._surface
        ways = (replace(numbers.ties, creased=least) for least in (np.inf, 0.0))
        return tuple(
            self._of(self.scene, f"creased {ties.creased}", replace(numbers, ties=ties))
            for ties in ways
        )

    @cached_property
    def turning(self) -> WeldedMeshes | None:
        """The meshes with joints that turned left alone; None where no joint turns so far."""
        scene = self.scene.turning
        return None if scene is None else self._of(scene, "turning")

    @cached_property
    def dressed(self) -> WeldedMeshes | None:
        """The meshes with garments tied to what they lie over; None where nothing can be."""
        if self.scene.dressed or len(self.scene.garments.vertices) == 0:
            return None
        return self._of(self.scene.changed("held", dressed=True), "dressed")

    @cached_property
    def undressed(self) -> WeldedMeshes:
        """The meshes with garments free."""
        return self._of(self.scene.changed("held", dressed=False), "undressed")

    @cached_property
    def inner(self) -> PartMeshes[SubScene] | None:
        """The meshes of what open layers lie over; None where there are none."""
        return self._parts("inner", inner_parts)

    @cached_property
    def outer_sides(self) -> PartMeshes[OuterSides] | None:
        """The meshes of all but the inner sides of thin shells; None where there are none."""
        return self._parts("outer sides", outer_sides)

    def _parts(self, way: str, make: Callable[[Scene], Part | None]) -> PartMeshes[Part] | None:
        """Return some parts of the scene, and their meshes; the published method knows none."""
        parts = None if self.scene.options.method == "paper" else make(self.scene)
        return None if parts is None else PartMeshes(parts, self._of(parts.scene, way))

    def of_bodies(self, bodies: tuple[int, ...]) -> PartMeshes[SubScene]:
        """Return the meshes of some of the bodies, as if there were no others."""
        if bodies not in self._groups:
            parts = sub_scene(self.scene, bodies)
            self._groups[bodies] = PartMeshes(parts, self._of(parts.scene, f"bodies {bodies}"))
        return self._groups[bodies]

    def with_inner_mobility(self, mobility: float) -> WeldedMeshes:
        """Return the meshes in which open layers lie over what moves at most so freely."""
        if self.scene.options.inner_mobility <= mobility:
            return self
        return self.with_options(f"mobility {mobility}", inner_mobility=mobility)

    def otherwise(
        self, bent: Sequence[Collection[int]], poses: Sequence[FloatArray]
    ) -> Iterator[WeldedMeshes]:
        """Yield other ways for strained poses (V, 3): without directions, with props rigid.

        bent: the bodies that are strained in their shape in each pose; those that one joint carries
        are props. That they are rigid helps where no other body is strained in its shape.
        """
        if self.undirected is not None:
            yield self.undirected
        props = props_among(self.scene, set().union(*bent), poses)
        if any(own and set(own) <= set(props) for own in bent):
            yield self.with_rigid(props)

    @property
    def with_props(self) -> WeldedMeshes:
        """The meshes with props rigid; these where there are none."""
        bodies = self.scene.bodies
        return self.with_rigid([k for k, body in enumerate(bodies) if body.prop])

    def with_rigid(self, bodies: Collection[int], *, wholes: bool = False) -> WeldedMeshes:
        """Return the meshes in which some bodies are rigid, too; wholes: see `as_wholes`."""
        props = tuple(k for k in sorted(bodies) if not self.scene.bodies[k].rigid)
        if not props:
            return self
        make, way = (as_wholes if wholes else with_rigid), f"rigid {props} {wholes}"
        if way not in self._ways:
            self._ways[way] = self._of(make(self.scene, props), way)
        return self._ways[way]

    def __call__(self, welds: Sequence[IntArray]) -> WeldedMesh:
        """Return the mesh of poses with welds (V,): what coincides there and at rest is one."""
        rest_weld = self.scene.rest_sewn
        joined = np.ones(len(rest_weld), dtype=bool)
        for weld in welds:
            joined &= weld[rest_weld] == weld
        together = np.where(joined, rest_weld, np.arange(len(rest_weld)))
        key = together.tobytes()
        if key not in self._known:
            self._known[key] = WeldedMesh(
                self.scene,
                together,
                self._queue,
                way=self.way,
                full=self._full,
                paper=self._paper,
                surface=self._surface,
            )
        return self._known[key]
