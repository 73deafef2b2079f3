"""What a repair did to a shape, part by part and region by region, and whether it is too much.

A mean over a mesh hides a ruined finger. So edges, attachments, volumes and turned triangles are
each measured where they are, against the pose of the input, and each has a bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray, IntArray, dots, lengths, vector_areas
from dtrepair.numerics.recent import Recent
from dtrepair.numerics.scale import WHOLE, Scale
from dtrepair.numerics.worn.loops import Rings
from dtrepair.repair.strain.bounds import Excess, StrainOptions
from dtrepair.repair.strain.parts import ConnectedParts, changes
from dtrepair.repair.strain.turning import turned_patches
from dtrepair.repair.strain.volumes import Solids

Places = NDArray[np.integer]


class _Changed(NamedTuple):
    """What a correction spoilt: edges, how far each tie (N,) came off, diagonals, and all else.

    away: the same for the looser bounds, by which no way back to where it was modelled counts.
    limb: the largest change of the volume of a limb, whether that is too much or not.
    """

    edges: list[Excess]
    drift: FloatArray
    away: FloatArray
    others: list[Excess]
    limb: float


class StrainMeter:
    """Measures what became of the parts of a mesh.

    Args:
        parts: The parts.
        references: Poses (V, 3) that show how attached parts were modelled; none: each input.
        rest: The pose (V, 3) by which parts are cut into limbs, and which tells how patches lie;
            None: limbs are not judged, and patches by how they are folded alone.
        crossed: Triangles (N,) of the parts that meet their own part at rest, where it does not
            tell how patches lie.
        rings: What is worn and must not come off; None: that is not judged.
        scale: What lengths are measured in.
        options: The bounds.
    """

    def __init__(
        self,
        parts: ConnectedParts,
        *,
        references: Sequence[FloatArray] = (),
        rest: FloatArray | None = None,
        crossed: IntArray | None = None,
        rings: Rings | None = None,
        scale: Scale = WHOLE,
        options: StrainOptions = StrainOptions(),
    ) -> None:
        self.parts, self.references, self.rest, self.options = parts, references, rest, options
        self.crossed, self.rings, self.scale = crossed, rings, scale
        # Corrections of one input are measured in turn, each by the strict bounds, too.
        self._offsets_before, self._areas_before = Recent[FloatArray](), Recent[FloatArray]()
        self._changes = Recent[_Changed]()

    def __call__(
        self,
        before: FloatArray,
        after: FloatArray,
        *,
        strict: bool = False,
        loosely: bool = False,
    ) -> list[Excess]:
        """Return what is beyond its bound in a pose (V, 3), against that of the input.

        strict: what relief aims at: all may slide a little less, and all bounds are told, not only
        the first that a joint passes. loosely: what may be where something would be left else:
        parts go back to where they were modelled by any way, and what the input let go farther off.
        """
        if np.array_equal(before, after):
            return []
        size = self.scale.diagonal(before) or 1.0
        edges, drift, away, others, _ = self._changes(self._changed, before, after)
        own = away if loosely else drift
        return [*edges, *self._drifts(own, before, size, strict, loosely), *others]

    def _changed(self, before: FloatArray, after: FloatArray) -> _Changed:
        """Return what does not depend on how strict the bounds are."""
        size = self.scale.diagonal(before) or 1.0
        of = partial(vector_areas, faces=self.parts.faces)
        old, new = self._areas_before(of, before), of(after)
        volumes = self._solids.changes(before, after, old, new)
        others = [
            *self._volumes(before, after, volumes),
            *self._flips(before, after, old, new, size),
            *self._taken_off(before, after),
        ]
        edges = self._spoilt_edges(before, after, size)
        limb = max((float(own.max(initial=0.0)) for own in volumes[1:]), default=0.0)
        return _Changed(edges, *self._drift(before, after, size), others, limb)

    def _spoilt_edges(self, before: FloatArray, after: FloatArray, size: float) -> list[Excess]:
        """Return parts, or else bodies, with too many edges that changed by the factor."""
        options, (first, second) = self.options, self.parts.edges.T
        ends = [pose.take(first, axis=0) - pose.take(second, axis=0) for pose in (before, after)]
        old, new = (dots(vectors, vectors) for vectors in ends)
        square = options.factor**2
        spoilt = (new > square * old) | (square * new < old)
        spoilt &= (np.maximum(old, new) > (options.point * size) ** 2) & (old > 0.0)
        found = np.flatnonzero(spoilt)
        if len(found) <= options.edges:
            return []
        floor = (1e-12 * size) ** 2
        change = np.abs(np.log(np.maximum(new[found], floor) / old[found]))
        own = self.parts.of_edge[found]
        result = self._crowded(own, self.parts.of_edge, found, change)
        if not result:
            bodies = self.parts.body
            result = self._crowded(bodies[own], bodies[self.parts.of_edge], found, change)
        return result

    def _crowded(
        self, group: Places, group_of_edge: Places, found: Places, change: FloatArray
    ) -> list[Excess]:
        """Return the groups with more of the edges `found` than allowed; `change` of each."""
        every = np.bincount(group_of_edge)
        bounds = np.maximum(self.options.edges, self.options.edges_share * every)
        counts = np.bincount(group, minlength=len(every))
        result = []
        for index in np.flatnonzero(counts > bounds):
            own = group == index
            edges = self.parts.edges[found[own]]
            worst = int(edges[np.argmax(change[own]), 0])
            part = int(self.parts.of_vertex[worst])
            value, bound = float(counts[index]), float(np.floor(bounds[index]))
            result.append(
                Excess(StrainKind.EDGES, part, value, bound, worst, np.unique(edges.ravel()))
            )
        return result

    def _drift(
        self, before: FloatArray, after: FloatArray, size: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return how far (N,), diagonals, each tied vertex came off; of no ties none.

        What goes back to where it was modelled has not. In the first that holds of ties that the
        input led off by more than `joint`, and that move by `drift` at most or are of small parts,
        as a pouch that sank into its vest; in the second, for the looser bounds, of all.
        """
        if self.parts.ties is None:
            return np.zeros(0), np.zeros(0)
        offsets = self.parts.tie_offsets(after)
        drift = changes(self._offsets_before(self.parts.tie_offsets, before), offsets) / size
        # Whatever the bounds, nothing is told below this.
        if self.references and drift.max() > self.options.slide * min(self.options.aim, 1.0):
            away = np.fmin(drift, changes(self._modelled, offsets / size))
            leaps = (drift > self.options.drift) & ~self._sitting
            held = ~self.let_go(before, self.options.joint)
            return np.where(leaps | held, drift, away), away
        return drift, drift

    def _drifts(
        self, drift: FloatArray, before: FloatArray, size: float, strict: bool, loosely: bool
    ) -> list[Excess]:
        """Return where attached parts came off each other, or slid, by their `_drift` (N,)."""
        if not len(drift):
            return []
        options = self.options
        slide = options.slide * (options.aim if strict else 1.0)
        if drift.max() <= min(options.drift, options.joint, slide):
            return []
        held = ~self.let_go(before, options.joint)
        most = np.where(held, options.drift, options.loose if loosely else options.drift)
        joint = max(options.joint, options.drift) if loosely else options.joint
        least = np.where(held | strict, min(options.drift, options.joint), most)
        result = []
        for index in np.unique(self.parts.joint[drift > min(options.drift, options.joint)]):
            own = np.flatnonzero(self.parts.joint == index)
            far = float(np.quantile(drift[own[held[own]]], 0.95)) if held[own].any() else 0.0
            worst = own[np.argmax(drift[own] / most[own])]
            # A joint is told by the first of its bounds that is passed, and all only if none is.
            beyond = []
            if drift[worst] > most[worst]:
                beyond.append((StrainKind.DRIFT, float(drift[worst]), float(most[worst])))
            if far > joint and (strict or not beyond):
                beyond.append((StrainKind.SLIDE, far, joint))
            for kind, value, bound in beyond:
                result.append(self._slid(kind, value, bound, worst, own[drift[own] > least[own]]))
        every = float(np.quantile(drift, 0.95))
        if every > slide and (strict or not result):
            worst, concerned = int(np.argmax(drift)), np.flatnonzero(drift > slide)
            result.append(self._slid(StrainKind.SLIDE, every, slide, worst, concerned))
        return result

    def let_go(self, pose: FloatArray, bound: float) -> NDArray[np.bool_]:
        """Return which ties (N,) a pose (V, 3) of the input has led off their place at rest."""
        if not self.references:
            return np.zeros(len(self.parts.joint), dtype=bool)
        shown = self._offsets_before(self.parts.tie_offsets, pose)
        return changes(self._modelled, shown / (self.scale.diagonal(pose) or 1.0)) > bound

    @cached_property
    def _sitting(self) -> NDArray[np.bool_]:
        """Which ties (N,) are of a part that sits on one far larger, as a pouch on a vest."""
        assert self.parts.ties is not None
        ties, parts = self.parts.ties, self.parts
        areas = lengths(vector_areas(self.references[0], parts.faces))
        area = np.bincount(parts.of_face, areas, parts.count)
        sides = np.stack([ties.vertices, parts.corners[ties.triangles, 0]], axis=1)
        both = area[parts.of_vertex[sides]]
        return np.asarray(both.max(axis=1) > self.options.larger * both.min(axis=1))

    @cached_property
    def _modelled(self) -> FloatArray:
        """The offsets (N, 2, 3) of ties, in diagonals, in the reference where each is shortest."""
        size = self.scale.diagonal
        shown = np.stack([self.parts.tie_offsets(p) / size(p) for p in self.references])
        shortest = np.argmin(np.linalg.norm(shown[:, :, 0], axis=2), axis=0)
        return np.asarray(shown[shortest, np.arange(shown.shape[1])])

    def _slid(
        self, kind: StrainKind, value: float, bound: float, worst: int, concerned: Places
    ) -> Excess:
        """Return the excess of some ties, and the tie where it is worst."""
        assert self.parts.ties is not None
        corners = self.parts.corners[self.parts.ties.triangles[concerned]].ravel()
        vertices = np.unique(np.concatenate([self.parts.ties.vertices[concerned], corners]))
        vertex = int(self.parts.ties.vertices[worst])
        corner = self.parts.corners[self.parts.ties.triangles[worst], 0]
        part, other = self.parts.of_vertex[[vertex, corner]].tolist()
        return Excess(kind, part, float(value), bound, vertex, vertices, other)

    def _volumes(
        self, before: FloatArray, after: FloatArray, changed: list[FloatArray]
    ) -> list[Excess]:
        """Return closed parts and limbs with another volume; changed: by `Solids.changes`."""
        options, result = self.options, []
        bounds = {"volume": options.volume, "limb": options.limb, "wire": options.wire}
        for kind, part, own, change, bound in self._solids.beyond(changed, **bounds):
            worst = int(own[np.argmax(lengths(after[own] - before[own]))])
            result.append(Excess(kind, part, change, bound, worst, own))
        return result

    def limb_change(self, before: FloatArray, after: FloatArray) -> float:
        """Return the largest change of the volume of a limb between poses (V, 3), 0 if none is."""
        if np.array_equal(before, after):
            return 0.0
        return self._changes(self._changed, before, after).limb

    @cached_property
    def _solids(self) -> Solids:
        """What has a volume to keep."""
        sheet, thicker = self.options.sheet, self.options.thicker
        return Solids(self.parts, self.rest, scale=self.scale, sheet=sheet, thicker=thicker)

    def _flips(
        self,
        before: FloatArray,
        after: FloatArray,
        old: FloatArray,
        new: FloatArray,
        size: float,
    ) -> list[Excess]:
        """Return patches of triangles that turned over; old, new: vector areas (F, 3)."""
        area = np.minimum(lengths(old), lengths(new))
        whole = np.bincount(self.parts.of_face, lengths(old), self.parts.count)
        bounds = np.minimum((self.options.patch * size) ** 2, self.options.patch_share * whole)
        few, result = self.options.patch_triangles, list[Excess]()
        turned = partial(turned_patches, rest=self.rest, crossed=self.crossed, few=few)
        rolls = self.options.patch_rolls
        for own in turned(self.parts, before, after, old, new, bounds, rolls=rolls):
            part = int(self.parts.of_face[own[0]])
            worst = int(self.parts.faces[own[np.argmax(area[own])], 0])
            value, bound = (float(np.sqrt(a)) / size for a in (area[own].sum(), bounds[part]))
            vertices = np.unique(self.parts.faces[own].ravel())
            result.append(Excess(StrainKind.FLIPS, part, value, bound, worst, vertices))
        return result

    def _taken_off(self, before: FloatArray, after: FloatArray) -> list[Excess]:
        """Return the parts that no longer go round what they did, each once."""
        if self.rings is None or self.options.worn >= 1.0:
            return []
        off, result = self.rings.taken_off(before, after), []
        for top in dict.fromkeys(ring.top for ring in off):
            vertices = self.rings.concerned(off, top)
            own = self.rings.parts.vertices[top]
            worst = int(own[np.argmax(lengths(after[own] - before[own]))])
            part, bound = int(self.parts.of_vertex[worst]), self.options.worn
            result.append(Excess(StrainKind.WORN, part, 1.0, bound, worst, vertices))
        return result
