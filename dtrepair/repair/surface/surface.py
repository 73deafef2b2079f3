"""What the repair knows of a mesh before it sees a pose: operators, adjacency, tree, factors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from dtrepair.device import Device
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.queries import Queries
from dtrepair.intersect.topology.components import link_labels
from dtrepair.intersect.topology.ring_distances import MOST_RINGS
from dtrepair.numerics.attachments import Attachments
from dtrepair.numerics.geometry import FloatArray, IntArray, extents, lengths, unit_vectors
from dtrepair.numerics.operators import (
    Factor,
    Factorise,
    Solver,
    cotangent_laplacian,
    lumped_mass,
    uniform_laplacian,
)
from dtrepair.numerics.scale import WHOLE, Scale
from dtrepair.numerics.work import uncounted
from dtrepair.numerics.worn.covering import Covering
from dtrepair.repair.surface.contacts import Contacts
from dtrepair.repair.surface.layers import (
    Label,
    covered_vertices,
    covering_sides,
    labels_of,
    without_crossing,
)
from dtrepair.repair.surface.rigid_bodies import RigidBodies, RigidOptions
from dtrepair.repair.surface.ties import TieOptions, TieSystem, tie_system
from dtrepair.repair.surface.topology import Topology

BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class SurfaceOptions:
    """Numbers of the operators of a surface.

    Args:
        cotangent_clamp: Least and largest weight of the cotangent Laplacian; with positive ones a
            diffused field has no overshoot.
        anchor: Weight of the input in the as-rigid-as-possible steps, next to that of the edges:
            small, so that what is not held drifts back slowly.
        covered_within: A vertex covers what is nearer than this fraction of the size of its body.
        covered_slide: What lay farther from what it covers than this fraction of the smaller extent
            of the two bodies or parts is beside it.
        neighbour_rings: Triangles at most so many edge rings apart are the sides of a crease to a
            clearance, which they cannot keep.
        usual_edge: Mean length of edges, over the size of what moves, for which rings of contacts,
            of fills and diffusion are meant: a skin of finer ones has more, see `Topology.rings`.
        rigid: Of bodies that only move as a whole.
        ties: How strongly attached parts hold.
    """

    cotangent_clamp: tuple[float, float] = (1e-3, 1e3)
    anchor: float = 0.01
    covered_within: float = 0.1
    covered_slide: float = 0.25
    neighbour_rings: int = 6
    usual_edge: float = 0.006
    rigid: RigidOptions = field(default_factory=RigidOptions)
    ties: TieOptions = field(default_factory=TieOptions)


@dataclass(frozen=True)
class BodyRange:
    """The vertices start..stop of one body, its diffusion strength lambda, whether it is rigid."""

    start: int
    stop: int
    diffusion: float
    rigid: bool = False


class Surface(Topology):
    """One mesh, or several bodies in one mesh, ready to be repaired in any pose.

    Lengths are in units of `size`, the largest coordinate range of the rest pose, by `scale`, so
    that step sizes mean the same for every mesh. Everything comes from the rest pose once and is
    never changed; what is remembered from pose to pose has an owner of its own, `contacts`. Several
    bodies share a triangle only along closed seams, so every operator is block diagonal but for
    clusters; each has its own diffusion factor (Jang et al. 2025, section 7.5.2).

    Args:
        rest: Rest positions (V, 3), any length unit.
        faces: Triangles (F, 3).
        bodies: Vertex ranges of the bodies; default: one body of strength 99.
        body_of: The body (F,) of each triangle; default: that of its vertices. The vertices of a
            seam belong to the first of its bodies.
        mobility: How freely each vertex moves (V,), 0 fixed to 1 free; default: all free.
        mode: Which pairs count: "self", "inter" (between bodies) or "both".
        leave_rest: Leave pairs and folds alone that the rest pose has as well.
        direction: Preferred direction (V, 3) of the repair, zero rows where none.
        ignored: Pairs of bodies, each pair (i, j) with i <= j, whose contacts do not count.
        device: Where its kernels run, "cpu" or "cuda:N": what works on a surface names none.
        factor: What its systems are factorised by.
        options: Numbers of the operators.
        attachments: Contacts that were modelled; they do not count, and their ties hold.
        covering: What open layers cover, by vertices; None: nothing is known.
        scale: What lengths are measured in.
    """

    def __init__(
        self,
        rest: FloatArray,
        faces: IntArray,
        *,
        bodies: Sequence[BodyRange] | None = None,
        body_of: NDArray[np.integer] | None = None,
        mobility: FloatArray | None = None,
        mode: str = "both",
        leave_rest: bool = False,
        direction: FloatArray | None = None,
        ignored: Sequence[tuple[int, int]] = (),
        device: str = "cpu",
        factor: Factorise = Factor,
        options: SurfaceOptions = SurfaceOptions(),
        attachments: Attachments | None = None,
        covering: Covering | None = None,
        scale: Scale = WHOLE,
    ) -> None:
        self.options, self.covering, self.factor = options, covering, factor
        self._arap_factors: dict[float, Solver] = {}
        self.bodies = tuple(bodies or (BodyRange(0, len(rest), 99.0),))
        sizes = [body.stop - body.start for body in self.bodies]
        self.body_of_vertex = np.repeat(np.arange(len(self.bodies)), sizes)
        self.scale, self.size = scale, scale.extent(rest) or 1.0
        self.ties: TieSystem | None = None
        if attachments is not None:
            scaled = rest / self.size
            self.ties = tie_system(attachments, faces, scaled, self.size, options=options.ties)
        super().__init__(
            faces, len(rest), links=self.ties and self.ties.links, device=Device(device)
        )
        self.rest = rest / self.size
        self.mobility = np.ones(self.count) if mobility is None else mobility
        self.body_of = self.body_of_vertex[faces[:, 0]] if body_of is None else body_of
        self.laplacian = self._tied_laplacian()
        self.uniform = uniform_laplacian(faces, self.count)
        self.mass = lumped_mass(self.rest, faces)
        self.in_zone: BoolArray = np.zeros(self.count, dtype=bool)
        if attachments is not None:
            self.in_zone = attachments.wholly_in_zones(faces, self.count)
        whole = [(body.start, body.stop) for body in self.bodies if body.rigid]
        self.rigid = RigidBodies(whole, self.mass, options=options.rigid)
        self.fixed = self.mobility == 0.0
        # Vertices that never move out of the shape of their surroundings.
        self.stiff = self.fixed | self.rigid.mask
        ends = self.edges[scale.counted(self.count)[self.edges[:, 0]]]
        self.edge_length = float(lengths(self.rest[ends[:, 0]] - self.rest[ends[:, 1]]).mean())
        still = np.array([self.fixed[body.start : body.stop].all() for body in self.bodies])
        moving = scale.counted(self.count) & ~still[self.body_of_vertex]
        self.set_fineness(self.rest, moving, options.usual_edge)
        self.detector = Detector(rest, faces, device=device)
        self.queries = Queries(self.detector)
        self.contacts = self._contacts(mode, ignored, attachments, leave_rest=leave_rest)
        self.direction = direction
        self.face_direction = (
            None if direction is None else unit_vectors(direction[faces].sum(axis=1))
        )

    def _tied_laplacian(self) -> sparse.csr_matrix:
        """Return the cotangent Laplacian (V, V) of the rest, with the edges of ties."""
        laplacian = cotangent_laplacian(self.rest, self.faces, clamp=self.options.cotangent_clamp)
        if self.ties is not None:
            laplacian = (laplacian + self.ties.laplacian).tocsr()
            laplacian.sort_indices()
        return laplacian

    def _contacts(
        self,
        mode: str,
        ignored: Sequence[tuple[int, int]],
        attachments: Attachments | None,
        *,
        leave_rest: bool,
    ) -> Contacts:
        return Contacts(
            self.detector,
            self.queries,
            self.rest,
            self.size,
            body_of=self.body_of,
            fixed=self.fixed,
            rigid=self.rigid.mask,
            mode=mode,
            ignored=tuple(ignored),
            leave_rest=leave_rest,
            neighbour_rings=self.rings(self.options.neighbour_rings),
            most_rings=self.rings(MOST_RINGS),
            attachments=attachments,
        )

    @cached_property
    def cluster_of_body(self) -> IntArray:
        """The cluster (B,) of bodies that ties or closed seams connect; else each is its own."""
        return link_labels(self.body_of_vertex[self.linked], len(self.bodies))

    @cached_property
    def part_sizes(self) -> FloatArray:
        """The size (P,) of each part at rest, units of the surface's; 1 of single vertices."""
        sizes = extents(self.rest, self.part_of_vertex)
        return np.where(sizes > 0.0, sizes, 1.0)

    @property
    def clusters(self) -> int:
        """How many there are of bodies, or groups of tied ones, apart from the set around."""
        own = self.body_of_vertex[self.scale.counted(self.count)]
        return len(np.unique(self.cluster_of_body[own]))

    @cached_property
    def diffusion_factors(self) -> list[tuple[slice | NDArray[np.intp], Solver]]:
        """The vertices of each cluster of bodies that may move, and the factor of M + lambda L.

        A body that nothing is tied to has a factor of its own.
        """
        factors: list[tuple[slice | NDArray[np.intp], Solver]] = []
        finer = self.fineness**2  # the unit of strengths is the area around a vertex
        for cluster in range(int(self.cluster_of_body.max(initial=-1)) + 1):
            bodies = [self.bodies[k] for k in np.flatnonzero(self.cluster_of_body == cluster)]
            moving = [b for b in bodies if not (b.rigid or self.fixed[b.start : b.stop].all())]
            if not moving:
                continue
            if len(moving) == 1:
                own: slice | NDArray[np.intp] = slice(moving[0].start, moving[0].stop)
                strong = finer * moving[0].diffusion * self.laplacian[own, own]
            else:
                own = np.concatenate([np.arange(b.start, b.stop) for b in moving])
                roots = [np.full(b.stop - b.start, np.sqrt(finer * b.diffusion)) for b in moving]
                scale = sparse.diags(np.concatenate(roots))
                strong = scale @ self.laplacian[own][:, own] @ scale
            system = sparse.diags(self.mass[own]) + strong
            factors.append((own, uncounted(partial(self.factor, system))))
        return factors

    @property
    def arap_factor(self) -> Solver:
        """Factor of L + anchor M for the as-rigid-as-possible steps."""
        return self.arap_factor_with(self.options.anchor)

    def arap_factor_with(self, anchor: float) -> Solver:
        """Return the factor of L + anchor M, made once for each anchor."""
        if anchor not in self._arap_factors:
            system = self.laplacian + anchor * sparse.diags(self.mass)
            self._arap_factors[anchor] = uncounted(partial(self.factor, system))
        return self._arap_factors[anchor]

    @cached_property
    def cover(self) -> IntArray:
        """The vertex (V,) of another body or part that each vertex covers at rest, or -1.

        Bodies that cross at rest cover each other only where the layers of other poses tell.
        """
        cover = uncounted(self._covered_bodies)
        if self.covering is None:
            return cover
        return np.where(cover >= 0, cover, self.covering.beneath)

    def covering_sides(self, pairs: IntArray) -> FloatArray | None:
        """Return -1 where a triangle of pairs (K, 2) covers the other one, else 1; None if none."""
        return covering_sides(self.rest, self.cover, self.faces, self._labels, pairs)

    @cached_property
    def _labels(self) -> list[Label]:
        """What each vertex belongs to: its body, and its part where layers are known."""
        slide, owner = self.options.covered_slide, self.body_of_vertex
        sheet = self.vertices_of(np.flatnonzero(self.sheets))
        shape = self.rest, self.vector_areas(self.rest), self.edges, sheet
        return labels_of(*shape, self.cover, owner, self.covering, slide=slide)

    def _covered_bodies(self) -> IntArray:
        """Return the vertex (V,) of another body that each vertex covers at rest, or -1."""
        bodies = [slice(body.start, body.stop) for body in self.bodies]
        normals, near = self.vector_areas(self.rest), self.options.covered_within
        cover = covered_vertices(self.rest, normals, self.edges, bodies, near=near)
        if not (cover >= 0).any():
            return cover
        crossing = self.body_of[self.detector(self.written(self.rest), exact=False)]
        return without_crossing(cover, self.body_of_vertex, crossing)

    def cluster_maxima(self, values: FloatArray) -> FloatArray:
        """Return the largest of the values (V,) of vertices over the cluster of each body (B,)."""
        of_body = np.maximum.reduceat(values, [body.start for body in self.bodies])
        largest = np.full(len(of_body), -np.inf)
        np.maximum.at(largest, self.cluster_of_body, of_body)
        return largest[self.cluster_of_body]

    @cached_property
    def offsets(self) -> sparse.csr_matrix | None:
        """T'T (V, V) of what holds tied vertices where they are tied; None without ties."""
        return None if self.ties is None else self.ties.offsets

    def diffuse(self, field: FloatArray, points: FloatArray | None = None) -> FloatArray:
        """Return A^-1 M A^-1 applied to a field (V, k), with A = M + lambda L of each body.

        Of rigid bodies the rigid part is taken, at the pose `points` (default: the rest); bodies
        that never move get zero.
        """
        result = np.zeros_like(field)
        for own, factor in self.diffusion_factors:
            if field[own].any():
                result[own] = factor(self.mass[own, None] * factor(field[own]))
        return self.rigid.moved(self.rest if points is None else points, field, result)

    def evened(self, field: FloatArray) -> FloatArray:
        """Return A^-1 M applied to a field (V, 3) of each body: what is constant stays as it is."""
        result = field.copy()
        for own, factor in self.diffusion_factors:
            if field[own].any():
                result[own] = factor(self.mass[own, None] * field[own])
        return result

    def written(self, points: FloatArray) -> NDArray[np.float32]:
        """Return points in units of `size` as the float32 coordinates that are counted."""
        return (points * self.size).astype(np.float32)

    def vector_areas(self, points: FloatArray) -> FloatArray:
        """Return the vector area (V, 3) of each vertex: a third of its triangles'."""
        return self.queries.vector_areas(points)
