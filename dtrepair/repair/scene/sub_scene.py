"""Some parts of a scene as one of their own: what lies under clothes, or meets no others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.attached.garments import room_between
from dtrepair.numerics.attachments import Attachments, Reference
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.worn.shells import Backing, Shell, thin_shells
from dtrepair.repair.scene.bodies import Body, widest_clearance
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.opened_pose import Pose, detected
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import Excess

Part = TypeVar("Part", bound="SubScene")


class SubScene:
    """Whole connected parts of a scene, without the rest of it.

    Args:
        outer: The whole scene.
        vertices: Their vertices (N,), in order.
    """

    def __init__(self, outer: Scene, vertices: IntArray) -> None:
        self.outer, self.vertices = outer, vertices
        self._place = np.full(len(outer.rest), -1, dtype=np.int32)
        self._place[vertices] = np.arange(len(vertices))
        self._triangles = np.flatnonzero((self._place[outer.faces] >= 0).all(axis=1))
        self._new_triangle = np.full(len(outer.faces), -1, dtype=np.int32)
        self._new_triangle[self._triangles] = np.arange(len(self._triangles))
        self.scene = self._scene()

    def own(self, pairs: IntArray) -> NDArray[np.bool_]:
        """Return which of the pairs (K, 2) of triangles of the whole are of these parts alone."""
        inner = self._new_triangle[pairs] >= 0
        return np.asarray(inner.all(axis=1), dtype=bool)

    def opened(self, frame: Pose) -> Pose:
        """Return a frame of the whole scene as one of these parts."""
        centred = frame.centred[self.vertices]
        weld = self.scene.weld(centred)
        own = replace(
            frame,
            given=(),
            original=frame.original[self.vertices],
            centred=centred,
            weld=weld,
            sewn=self.scene.sewn(centred, weld),
            detected=False,
            absent=None if frame.absent is None else frame.absent[self.vertices],
            begun=None,
        )
        return detected(self.scene, own)

    def closed(self, frame: Pose, points: FloatArray) -> Pose:
        """Return a frame of the whole scene in which these parts are at points (N, 3)."""
        centred = self.placed(frame.centred, points)
        return detected(self.outer, replace(frame, centred=centred, detected=False))

    def placed(self, whole: FloatArray, points: FloatArray) -> FloatArray:
        """Return a pose (V, 3) of the whole in which these parts are at points (N, 3)."""
        result = whole.copy()
        result[self.vertices] = points
        return result

    def joined(self, whole: Judged, found: Judged) -> Judged:
        """Return what was found for the whole with what was found for these parts."""
        return Judged(
            self.placed(whole.points, found.points),
            (*whole.excess, *self._outer_excess(found.excess)),
            whole.lowered or found.lowered,
            whole.turned or found.turned,
        )

    def _outer_excess(self, excess: Sequence[Excess]) -> tuple[Excess, ...]:
        """Return what is strained in these parts by the numbers of the whole."""
        part_of = self.outer.strain_meter.parts.of_vertex if excess else self.vertices
        return tuple(
            own._replace(
                part=int(part_of[self.vertices[own.worst]]),
                worst=int(self.vertices[own.worst]),
                vertices=self.vertices[own.vertices],
            )
            for own in excess
        )

    def _scene(self) -> Scene:
        """Return the scene of these parts alone; bodies of which nothing is left are left out."""
        outer, own = self.outer, self._triangles
        body_of_vertex, body_of = outer.body_of_vertex[self.vertices], outer.body_of[own]
        kept, starts = np.unique(body_of_vertex, return_index=True)
        place = {int(body): k for k, body in enumerate(kept)}
        triangles = np.searchsorted(body_of, kept)
        bodies = tuple(self._body(int(body)) for body in kept)
        return replace(
            outer,
            bodies=bodies,
            ignored=tuple(
                (place[a], place[b]) for a, b in outer.ignored if a in place and b in place
            ),
            rest=outer.rest[self.vertices],
            faces=self._place[outer.faces[own]],
            vertex_starts=np.append(starts, len(self.vertices)),
            triangle_starts=np.append(triangles, len(own)),
            mobility=outer.mobility[self.vertices],
            direction=outer.direction[self.vertices],
            references=tuple(map(self._reference, outer.references)),
            layer_poses=tuple(map(self._reference, outer.layer_poses)),
        )

    def _body(self, index: int) -> Body:
        """Return what is left of a body."""
        outer, body = self.outer, self.outer.bodies[index]
        vertices = self.vertices[outer.body_of_vertex[self.vertices] == index]
        triangles = self._triangles[outer.body_of[self._triangles] == index]
        place = vertices - outer.vertices_of(index).start
        told = triangles - outer.triangles_of(index).start
        return replace(
            body,
            rest=outer.rest[vertices],
            faces=self._place[outer.faces[triangles]] - self._place[vertices[0]],
            pin=None if body.pin is None else np.asarray(body.pin)[place],
            direction=None if body.direction is None else np.asarray(body.direction)[place],
            layer=None if body.layer is None else np.asarray(body.layer)[told],
        )

    def _reference(self, reference: Reference) -> Reference:
        """Return what a pose shows of these parts."""
        bound = reference.bound
        return reference._replace(
            points=reference.points[self.vertices],
            pairs=self._new_triangle[reference.pairs[self.own(reference.pairs)]],
            bound=None if bound is None else bound[self._triangles],
        )


def room_over(inner: SubScene) -> float | None:
    """Return the clearance that what lies over some parts needs; None where nothing does."""
    scene, ties = inner.outer, inner.outer.garments
    if scene.covering is None or len(ties.vertices) == 0:
        return None
    layers = int(scene.covering.depth.max())
    room = room_between(ties, scene.centred_rest, scene.enclosures.faces, layers)
    return min(room, widest_clearance(inner.scene.rest))


class OuterSides(SubScene):
    """A scene without the inner sides of thin shells, which go along with the outer ones.

    Args:
        outer: The whole scene.
        shells: The shells, their vertices as those that stand for others at one place of the rest.
    """

    def __init__(self, outer: Scene, shells: Sequence[Shell]) -> None:
        self.shells, self._stand = shells, outer.rest_weld
        inner = [shell.inner for shell in shells]
        self._inner = np.isin(outer.rest_weld, np.concatenate(inner))
        super().__init__(outer, np.flatnonzero(~self._inner).astype(np.int32))
        faces, rest = outer.enclosures.faces, outer.layers.parts.poses[0]
        sides = [faces[np.isin(faces, shell.outer).all(axis=1)] for shell in shells]
        self._backings = [Backing(rest, *both) for both in zip(sides, inner, strict=True)]

    def placed(self, whole: FloatArray, points: FloatArray) -> FloatArray:
        """Return a pose (V, 3) of the whole in which these parts are at points (N, 3)."""
        result = super().placed(whole, points)
        shift = np.zeros_like(whole)
        for backing in self._backings:
            shift[backing.vertices] = backing.followed(whole, result)
        result[self._inner] += shift[self._stand[self._inner]]
        return result

    def pairs_of_shells(self, pairs: IntArray) -> int:
        """Return how many pairs (K, 2) of triangles of the whole a shell has with other parts."""
        parts = self.outer.enclosures.part_of_face[pairs]
        own = np.isin(parts, [shell.part for shell in self.shells])
        return int((own.any(axis=1) & (parts[:, 0] != parts[:, 1])).sum())


def outer_sides(scene: Scene) -> OuterSides | None:
    """Return a scene without the inner sides of thin shells; None where there are none.

    What is pinned follows nothing.
    """
    if scene.options.maximum_displacement is not None or scene.enclosures.count < 2:
        return None
    mobility = np.ones(len(scene.rest))
    np.minimum.at(mobility, scene.rest_weld, scene.mobility)
    shells = [own for own in thin_shells(scene.layers) if (mobility[own.inner] == 1.0).all()]
    return OuterSides(scene, shells) if shells else None


def sub_scene(scene: Scene, bodies: Sequence[int]) -> SubScene:
    """Return some of the bodies of a scene."""
    own = np.isin(scene.body_of_vertex, bodies)
    return SubScene(scene, np.flatnonzero(own).astype(np.int32))


def inner_parts(scene: Scene) -> SubScene | None:
    """Return the parts of a scene that are no open layer; None where none lies over them.

    None, too, where displacements are limited, which holds from the input on, and where parts are
    attached: their frames are solved each for itself, and what is sewn on would be torn off.
    """
    covering, limited = scene.covering, scene.options.maximum_displacement is not None
    if covering is None or limited or scene.held is not None:
        return None
    outer: NDArray[np.bool_] = np.asarray(covering.over.any(axis=1))[covering.part]
    used = np.zeros(len(outer), dtype=bool)
    used[scene.faces] = True
    vertices = np.flatnonzero(used & ~outer).astype(np.int32)
    return SubScene(scene, vertices) if len(vertices) else None


def attachments_of(scene: Scene, body: int) -> Attachments | None:
    """Return what was modelled within one body, by its own triangles and vertices."""
    if scene.attachments is None:
        return None
    own = scene.triangles_of(body)
    place = np.arange(len(scene.rest)) - scene.vertices_of(body).start
    return scene.attachments.of_triangles(np.arange(own.start, own.stop), place)
