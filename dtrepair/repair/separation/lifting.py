"""What is worn is lifted off what came through it, before contacts are pushed.

A push moves both sides of a contact the short way, which for a sleeve deep in its arm may be
inwards. Where one part is known to lie over another, each of its vertices that went under is led
back to the surface whose normal agrees with its own, and the layer follows smoothly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import cKDTree

from dtrepair.numerics.closest_point import closest_on_triangles
from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    dots,
    extent,
    lengths,
    triangle_normals,
    vertex_areas,
)
from dtrepair.numerics.operators import Factor, cotangent_laplacian
from dtrepair.numerics.temporal import gaussian_kernel, undamped
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
        neighbours: Triangles of the inner part that are looked at for a vertex.
        turn: Weight of the normals in the search for them, as a fraction of the smaller extent.
        rounds: Lifts in turn, each for what still lies under.
        edges, depths: A lift fades out over so many mean edges, and so many depths.
        hold: Weight of the lifted vertices next to the smoothness of the others.
        thick: Weight of the ties between the inner and the outer side of a closed layer.
        widths: Standard deviations, in frames, over which lifts come and go; each is for what those
            before it left under.
    """

    gap: float = 0.25
    aligned: float = 0.3
    neighbours: int = 8
    turn: float = 0.25
    rounds: int = 4
    edges: float = 3.0
    depths: float = 2.0
    hold: float = 100.0
    thick: float = 1.0
    widths: tuple[float, ...] = (3.5, 1.75, 0.0)


def lifted_frames(
    scene: Scene,
    poses: FloatArray,
    met: Sequence[IntArray],
    frames: FloatArray,
    *,
    options: LiftOptions = LiftOptions(),
) -> FloatArray:
    """Return poses (T, V, 3) with all layers lifted off the parts that they lie over.

    With a largest displacement all is left to the repair of contacts, which keeps to it.

    Args:
        scene: The bodies.
        poses: Poses (T, V, 3).
        met: Of each frame the parts (K, 2) that meet, or of which one is inside the other.
        frames: Times (T,) in frame units.
        options: Numbers of this stage.
    """
    if not _lifts(scene):
        return poses
    keys = {tuple(sorted(both)) for found in met for both in found.tolist()}
    found = [scene.layers.between(first, second) for first, second in sorted(keys)]
    layers = [layer for layer in found if layer is not None and _may_move(scene, layer)]
    if not layers:
        return poses
    result = poses.copy()
    for layer in _from_inside(layers):
        lift = _Lift(scene, layer, options)
        result = lift.steadily(result, frames)
    return result


def parts_that_meet(scene: Scene, pairs: IntArray, enclosed: IntArray) -> IntArray:
    """Return the parts (K, 2) of a pose that meet by pairs (P, 2), or lie inside each other."""
    parts = np.unique(np.sort(scene.enclosures.part_of_face[pairs], axis=1), axis=0)
    meeting: IntArray = np.concatenate([parts[parts[:, 0] != parts[:, 1]], enclosed])
    return meeting


def not_worn(scene: Scene, enclosed: IntArray) -> IntArray:
    """Return which parts (K, 2) inside others are no layers of these, which are lifted instead."""
    if not _lifts(scene):
        return enclosed
    layers = (scene.layers.between(inner, outer) for inner, outer in enclosed.tolist())
    loose = [layer is None or not _may_move(scene, layer) for layer in layers]
    parts: IntArray = enclosed[np.array(loose, dtype=bool)]
    return parts


def layered_bodies(scene: Scene, pairs: Sequence[IntArray]) -> set[tuple[int, int]]:
    """Return bodies (first < second) of which one is a layer over the other where they meet.

    pairs: of each frame the pairs (K, 2) of triangles that intersect. Lifts lead such bodies.
    """
    if not _lifts(scene):
        return set()
    none = np.zeros((0, 2), dtype=np.int32)
    met = np.unique(np.concatenate([parts_that_meet(scene, own, none) for own in pairs]), axis=0)
    bodies = np.sort(scene.body_of_part[met], axis=1)
    layers = (scene.layers.between(first, second) for first, second in met.tolist())
    led = [layer is not None and _may_move(scene, layer) for layer in layers]
    return {(int(a), int(b)) for a, b in bodies[np.array(led, dtype=bool)] if a != b}


def _lifts(scene: Scene) -> bool:
    """Return whether layers are lifted at all: by the full method, and without a limit."""
    return scene.options.method == "full" and scene.options.maximum_displacement is None


def _may_move(scene: Scene, layer: WornLayer) -> bool:
    """Return whether a layer may be moved freely: neither stiff nor directed."""
    own = scene.enclosures.vertices(layer.top)
    body = int(scene.body_of_vertex[own[0]])
    free = not scene.is_stiff(body) and bool((scene.mobility[own] > 0.0).any())
    return free and not scene.direction[own].any()


def _from_inside(layers: list[WornLayer]) -> list[WornLayer]:
    """Return layers such that what lies beneath comes first; circles are cut anywhere."""
    height = {part: 0 for layer in layers for part in (layer.top, layer.under)}
    for _ in layers:
        for layer in layers:
            height[layer.top] = min(max(height[layer.top], height[layer.under] + 1), len(layers))
    return sorted(layers, key=lambda layer: (height[layer.top], layer.top, layer.under))


class _Lift:
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
        self.place = self.place[scene.rest_weld]
        rest = scene.rest[self.own]
        local = np.searchsorted(self.own, self.faces).astype(np.int32)
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
        laplacian = cotangent_laplacian(rest, local, clamp=(1e-3, 1e3))
        if parts.closed[layer.top]:
            # The outer side follows the inner one.
            facing = self._facing(heights)
            laplacian = laplacian + self._ties(rest, facing)
            self.led &= facing
        self.stiffness = laplacian @ sparse.diags(1.0 / self.mass) @ laplacian
        self.fixed = scene.mobility[self.own] == 0.0
        self.fixed[np.searchsorted(self.own, scene.attached_parts.held(layer.top))] = True
        self.turn = options.turn * min(
            extent(rest), extent(scene.rest[parts.vertices[layer.under]])
        )

    def __call__(self, pose: FloatArray) -> FloatArray:
        """Return displacements (n, 3) that lead what went under of a pose (V, 3) back."""
        options, own = self.options, pose[self.own]
        shift, target = np.zeros_like(own), np.zeros_like(own)
        held = np.zeros(len(own), dtype=bool)
        for _ in range(options.rounds):
            under, needed = self._under(own + shift, pose)
            if not under.any():
                break
            target[under] = shift[under] + needed[under]
            held |= under
            shift = self._smooth(held, target)
        return shift

    def steadily(self, poses: FloatArray, frames: FloatArray) -> FloatArray:
        """Return poses (T, V, 3) at `frames` (T,) with the layer lifted, smoothly in time."""
        for width in self.options.widths if len(frames) > 1 else (0.0,):
            shifts = np.stack([self(pose) for pose in poses])
            if not shifts.any():
                break
            shifts = undamped(gaussian_kernel(frames, width), shifts)
            poses = np.stack([self.moved(*both) for both in zip(poses, shifts, strict=True)])
        return poses

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

    def _under(self, points: FloatArray, pose: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
        """Return which vertices (n,) went under the inner part, and the way back (n, 3)."""
        options = self.options
        moved = pose.copy()
        moved[self.own] = points
        outward = self.sides[:, None] * vertex_normals(moved, self.faces, self.own)
        corners = pose[self.other_faces]
        normals = triangle_normals(pose, self.other_faces)
        tree = cKDTree(np.hstack([corners.mean(axis=1), self.turn * normals]))
        led = np.flatnonzero(self.led)
        count = min(options.neighbours, len(corners))
        query = np.hstack([points[led], self.turn * outward[led]])
        near = tree.query(query, np.arange(1, count + 1))[1]
        starts = np.repeat(points[led], count, axis=0)
        closest = closest_on_triangles(starts, corners[near.ravel()]).reshape(len(led), count, 3)
        distance = np.linalg.norm(closest - points[led][:, None], axis=2)
        cosine = np.einsum("ij,ikj->ik", outward[led], normals[near])
        distance[cosine < options.aligned] = np.inf
        rows, best = np.arange(len(led)), distance.argmin(axis=1)
        closest, normal = closest[rows, best], normals[near[rows, best]]
        height = dots(points[led] - closest, normal)
        lost = np.isfinite(distance[rows, best]) & (height < 0.0) & self.covered[near[rows, best]]
        if self.closed and lost.any():
            where = np.flatnonzero(lost)
            lost[where] = windings(points[led][where], corners) > 0
        under = np.zeros(len(points), dtype=bool)
        under[led[lost]] = True
        needed = np.zeros_like(points)
        needed[led] = closest + self.gap[led][:, None] * normal - points[led]
        return under, needed

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
