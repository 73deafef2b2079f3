"""The displacement that leads one layer back over the part that it lies on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.closest_point import closest_on_triangles
from dtrepair.numerics.enclosure import Dipoles
from dtrepair.numerics.geometry import (
    FloatArray,
    dots,
    extent,
    lengths,
    triangle_normals,
    unique_edges,
    vertex_areas,
)
from dtrepair.numerics.operators import Factor, cotangent_laplacian
from dtrepair.numerics.worn.parts import vertex_normals
from dtrepair.numerics.worn.sides import WornLayer
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.surface.rays import windings


@dataclass(frozen=True, kw_only=True)
class LiftOptions:
    """How a layer is led back over what it lies on.

    Args:
        gap: Distance that a lifted vertex keeps, as a fraction of its longest edge, at most what it
            has in the rest.
        aligned: Least cosine between the normals of a vertex and of the surface it is led to.
        slide: A vertex is led back to what lay this fraction of the smaller extent farther from it
            at rest than the inner part did, or twice as far as most of the layer slid: an arm that
            leans on a shirt is not what the shirt went under.
        reach: What was farther than this fraction of the smaller extent at rest is not led.
        neighbours: Triangles of the inner part that are looked at for a vertex.
        turn: Weight of the normals in the search for them, as a fraction of the smaller extent.
        enclosed: Least winding number of an open inner part where a vertex is under it; ...
        cells: ... so many along it are seen as one dipole each from afar.
        wide: A region is led back where in some frame its way back is at most so many times its
            width and an edge.
        left: And where a first lift leaves at most this share of its ways back: a leg that comes
            out through a cape is never under it, however far the cape is raised.
        rounds: Lifts in turn, each for what still lies under.
        edges, depths: A lift fades out over so many mean edges, and so many depths.
        hold: Weight of the lifted vertices next to the smoothness of the others.
        thick: Weight of the ties between the inner and the outer side of a closed layer.
        widths: Standard deviations, in frames, over which lifts come and go; each is for what those
            before it left under.
        less: A narrower width than the one before follows only where the longest lift that is
            still needed is at most this fraction of the one needed before: a cape that arms come
            through ever again would only jump.
    """

    gap: float = 0.25
    aligned: float = 0.3
    slide: float = 0.25
    reach: float = 0.5
    neighbours: int = 8
    enclosed: float = 0.25
    cells: int = 64
    turn: float = 0.25
    wide: float = 1.75
    left: float = 0.5
    rounds: int = 4
    edges: float = 3.0
    depths: float = 2.0
    hold: float = 100.0
    thick: float = 1.0
    widths: tuple[float, ...] = (3.5, 3.5, 1.75, 0.0)
    less: float = 0.85


class Inner(NamedTuple):
    """A pose (V, 3), the inner part there: corners (F, 3, 3), normals (F, 3), a tree of both.

    dipoles: of an open part, what tells how far it goes round a point.
    """

    pose: FloatArray
    corners: FloatArray
    normals: FloatArray
    tree: cKDTree
    dipoles: Dipoles | None


class Sunken(NamedTuple):
    """Which vertices (n,) of a layer went under the inner part, and their ways back (n, 3)."""

    under: NDArray[np.bool_]
    needed: FloatArray


class LayerLift:
    """Lifts one layer off what it lies over, in any pose."""

    def __init__(self, scene: Scene, layer: WornLayer, options: LiftOptions) -> None:
        self.options, parts = options, scene.layers.parts
        self.own = parts.vertices[layer.top]
        self.faces, self.other_faces = parts.triangles[layer.top], parts.triangles[layer.under]
        self.closed = bool(parts.closed[layer.under])
        self.covered = np.ones(len(self.other_faces), dtype=bool)
        if layer.covered is not None:
            self.covered[:] = np.isin(self.other_faces, layer.covered).any(axis=1)
        # All vertices at one place of the rest move along.
        self.place = np.full(len(scene.rest), -1)
        self.place[self.own] = np.arange(len(self.own))
        self.place = self.place[scene.rest_sewn]
        rest = scene.rest[self.own]
        local = np.searchsorted(self.own, self.faces).astype(np.int32)
        self.edges = unique_edges(local)
        self.mass = np.maximum(vertex_areas(rest, local), 1e-12 * extent(rest) ** 2)
        spacing = parts.spacing[self.own]
        self.edge = float(spacing.mean())
        inside = np.searchsorted(self.own, layer.vertices)
        self.sides = np.zeros(len(self.own))
        self.sides[inside] = layer.sides
        heights = np.full(len(self.own), np.inf)
        heights[inside] = layer.heights
        self.gap = np.minimum(heights, options.gap * spacing)
        self.led = self.sides != 0.0
        # What goes round something wide lies near none of it.
        self.near = np.isfinite(heights) | ~np.isfinite(heights).any()
        laplacian = cotangent_laplacian(rest, local, clamp=(1e-3, 1e3))
        if parts.closed[layer.top]:
            # The outer side follows the inner one.
            facing = self._facing(heights)
            laplacian = laplacian + self._ties(rest, facing)
            self.led &= facing
        self.stiffness = laplacian @ sparse.diags(1.0 / self.mass) @ laplacian
        self.fixed = scene.mobility[self.own] == 0.0
        self.fixed[np.searchsorted(self.own, scene.attached_parts.held(layer.top))] = True
        # Rests of their own do not show how far apart the parts are.
        shown = parts.poses[0]
        beneath = shown[parts.vertices[layer.under]]
        smaller = min(extent(rest), extent(beneath))
        self.turn, self.slide = options.turn * smaller, options.slide * smaller
        self.shown, self.shown_middles = shown[self.own], shown[self.other_faces].mean(axis=1)
        self.shown_distance = cKDTree(beneath).query(self.shown)[0]
        if not self.near.all():
            self.led &= self.shown_distance < options.reach * smaller

    def __call__(
        self, pose: FloatArray, wide: NDArray[np.bool_], sunken: Sunken | None = None
    ) -> FloatArray:
        """Return displacements (n, 3) that lead what went under of a pose (V, 3) back.

        wide: vertices (n,); regions without any of them stay where they are. sunken: what went
        under, where that is known.
        """
        shift, target = np.zeros((2, len(self.own), 3))
        held, inner = np.zeros(len(self.own), dtype=bool), self.inner(pose)
        for _ in range(self.options.rounds):
            found = self.sunken(inner, shift) if sunken is None else sunken
            if not (under := self.among(found.under, wide)).any():
                break
            target[under] = shift[under] + found.needed[under]
            held |= under
            shift, sunken = self._smooth(held, target), None
        return shift

    def moved(self, pose: FloatArray, shift: FloatArray) -> FloatArray:
        """Return the pose (V, 3) with the vertices of the layer displaced by (n, 3)."""
        result, own = pose.copy(), self.place >= 0
        result[own] += shift[self.place[own]]
        return result

    def _smooth(self, held: NDArray[np.bool_], target: FloatArray) -> FloatArray:
        """Return the smooth displacement (n, 3) that is near the target where held."""
        options = self.options
        reach = max(options.edges * self.edge, options.depths * float(lengths(target).max()))
        weight = np.where(held, options.hold, 0.0)
        weight[self.fixed] = options.hold / 1e-6
        goal = np.where((held & ~self.fixed)[:, None], target, 0.0)
        system = sparse.diags(self.mass * (1.0 + weight)) + reach**4 * self.stiffness
        smooth = Factor(system)((self.mass * weight)[:, None] * goal)
        smooth[self.fixed] = 0.0
        return smooth

    def inner(self, pose: FloatArray) -> Inner:
        """Return the inner part in a pose (V, 3)."""
        corners, normals = pose[self.other_faces], triangle_normals(pose, self.other_faces)
        places = np.hstack([corners.mean(axis=1), self.turn * normals])
        # Fewer leaves are searched where they are large; of what is as near any may be found.
        tree = cKDTree(places, leafsize=64)
        # An arm is thinner than what of its body counts as one from afar: many cells.
        dipoles = None if self.closed else Dipoles(corners, self.options.cells)
        return Inner(pose, corners, normals, tree, dipoles)

    def sunken(self, inner: Inner, shift: FloatArray | float = 0.0) -> Sunken:
        """Return what went under the inner part, the layer displaced by (n, 3)."""
        points = inner.pose[self.own] + shift
        led, corners = np.flatnonzero(self.led), inner.corners
        known, triangles, closest = self._aligned(points, inner, led)
        normal = inner.normals[triangles]
        own, low = points[led], known & self.covered[triangles]
        low &= (dots(own - closest, normal) < 0.0) & self._covers(led, triangles, known)
        where = np.flatnonzero(low)
        if len(where) and inner.dipoles is not None:
            around = np.abs(inner.dipoles.enclose_closely(own[where]))
            low[where] = around > self.options.enclosed
        elif len(where):
            low[where] = windings(own[where], corners) > 0
        under = np.zeros(len(points), dtype=bool)
        under[led[low]] = True
        needed = np.zeros_like(points)
        needed[led] = closest + self.gap[led][:, None] * normal - own
        return Sunken(under, needed)

    def among(self, under: NDArray[np.bool_], wide: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return which vertices (n,) that went under are in regions with some that are wide."""
        vertices, region = self.regions(under)
        among = np.zeros(len(vertices), dtype=bool)
        among[region[wide[vertices]]] = True
        result = np.zeros_like(under)
        result[vertices] = among[region]
        return result

    def regions(self, under: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the vertices (N,) that went under, and the connected region (N,) of each."""
        vertices = np.flatnonzero(under)
        ends = self.edges[under[self.edges].all(axis=1)]
        label = link_labels(ends, len(under))[vertices]
        return vertices, np.unique(label, return_inverse=True)[1].reshape(-1)

    def _aligned(
        self, points: FloatArray, inner: Inner, led: NDArray[np.integer]
    ) -> tuple[NDArray[np.bool_], NDArray[np.integer], FloatArray]:
        """Return the nearest triangle (N,) turned as each led vertex, and the place there (N, 3).

        First, of which vertices (N,) there is any.
        """
        options, moved = self.options, inner.pose.copy()
        moved[self.own] = points
        outward = self.sides[:, None] * vertex_normals(moved, self.faces, self.own)
        count = min(options.neighbours, len(inner.corners))
        query = np.hstack([points[led], self.turn * outward[led]])
        near = inner.tree.query(query, np.arange(1, count + 1))[1]
        cosine = np.einsum("ij,ikj->ik", outward[led], inner.normals[near])
        turned = cosine >= options.aligned
        closest, distance = np.zeros((*near.shape, 3)), np.full(near.shape, np.inf)
        starts = np.broadcast_to(points[led][:, None], closest.shape)[turned]
        closest[turned] = closest_on_triangles(starts, inner.corners[near[turned]])
        distance[turned] = np.linalg.norm(closest[turned] - starts, axis=1)
        rows, best = np.arange(len(led)), distance.argmin(axis=1)
        return np.isfinite(distance[rows, best]), near[rows, best], closest[rows, best]

    def _covers(
        self,
        led: NDArray[np.integer],
        triangles: NDArray[np.integer],
        known: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Return whether led vertices (N,) may lie over triangles (N,), as far as these slid."""
        slid = lengths(self.shown_middles[triangles] - self.shown[led]) - self.shown_distance[led]
        usual = slid[known & self.near[led]]
        allowed = self.slide + 2.0 * max(0.0, float(np.median(usual)) if len(usual) else 0.0)
        covers: NDArray[np.bool_] = slid < allowed
        return covers

    def _facing(self, heights: FloatArray) -> NDArray[np.bool_]:
        """Return which vertices (n,) are of the side that faces the inner part: the nearer one."""
        means = {
            side: heights[self.sides == side].mean()
            for side in (1.0, -1.0)
            if (self.sides == side).any()
        }
        facing: NDArray[np.bool_] = self.sides == min(means, key=lambda side: means[side])
        return facing

    def _ties(self, rest: FloatArray, facing: NDArray[np.bool_]) -> sparse.csr_matrix:
        """Return the Laplacian (n, n) of links from other vertices to the nearest facing ones."""
        free, faced = np.flatnonzero(~facing), np.flatnonzero(facing)
        nearest = faced[cKDTree(rest[faced]).query(rest[free])[1]]
        weight = np.full(len(free), self.options.thick)
        half = sparse.coo_matrix((weight, (free, nearest)), shape=(len(rest), len(rest)))
        links = (half + half.T).tocsr()
        return (sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links).tocsr()
