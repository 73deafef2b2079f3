"""The bodies of a scene in one mesh, and pure questions to it: which vertices, which pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.intersect.detector import Detector, triangle_count
from dtrepair.intersect.ignored import counted_between
from dtrepair.numerics.attached.garments import garment_ties
from dtrepair.numerics.attached.seams import NO_SEAMS, Seams, find_seams, sewn
from dtrepair.numerics.attached.touches import without_touches
from dtrepair.numerics.attachments import Attachments, Reference, Ties, no_attachments, telling
from dtrepair.numerics.geometry import FloatArray, IntArray, unique_edges, weld_maps
from dtrepair.numerics.scale import Scale, scale_of
from dtrepair.numerics.worn.covering import Covering, learnt_layers, open_layers
from dtrepair.numerics.worn.layers import Layers, median_of_parts
from dtrepair.numerics.worn.loops import Rings
from dtrepair.numerics.worn.parts import Parts
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.scene.attached_parts import AttachedParts, known_attachments
from dtrepair.repair.scene.bodies import STIFF, Body, about_centre, layer_of, points_of
from dtrepair.repair.strain.bounds import StrainOptions
from dtrepair.repair.strain.letting_go import ties_that_hold
from dtrepair.repair.strain.meter import StrainMeter
from dtrepair.repair.strain.parts import ConnectedParts
from dtrepair.repair.surface.containment import Enclosures
from dtrepair.repair.surface.rigid_bodies import RigidBodies


@dataclass(frozen=True, eq=False)
class Scene:
    """Bodies in one space as one mesh; nothing of it changes after it was built.

    Args:
        bodies: The bodies (B), whose vertices and triangles are numbered through in this order.
        options: What the user chose.
        ignored: Pairs (i, j), i <= j, of bodies whose contacts do not count.
        rest: Rest positions (V, 3) of all bodies, length units of the scene.
        faces: Triangles (F, 3).
        vertex_starts: First vertex of each body, and the number of vertices (B + 1,).
        triangle_starts: First triangle of each body, and the number of triangles (B + 1,).
        mobility: How freely each vertex moves (V,), 0 fixed to 1 free.
        direction: Preferred direction (V, 3) of the repair, zero rows where none.
        references: Poses (V, 3) that show which contacts were modelled, each with the pairs (K, 2)
            that it may speak of.
        layer_poses: Poses (V, 3) that show which part lies over which, with all their pairs (K, 2);
            default: the rest.
        strain: What a correction may do to a shape.
        turns: Whether contacts are modelled where joints turned to, too.
        dressed: Whether garments are tied to what they lie over; no contact is modelled by that.
        device: Where poses are counted, before and after.
    """

    bodies: tuple[Body, ...]
    options: RepairOptions
    ignored: tuple[tuple[int, int], ...]
    rest: FloatArray
    faces: IntArray
    vertex_starts: NDArray[np.int64]
    triangle_starts: NDArray[np.int64]
    mobility: FloatArray
    direction: FloatArray
    references: tuple[Reference, ...] = ()
    layer_poses: tuple[Reference, ...] = ()
    strain: StrainOptions = StrainOptions()
    turns: bool = False
    dressed: bool = False
    device: str = "cpu"

    @cached_property
    def body_of(self) -> NDArray[np.int64]:
        """The body of each triangle (F,)."""
        return np.repeat(np.arange(len(self.bodies)), np.diff(self.triangle_starts))

    @cached_property
    def body_of_vertex(self) -> IntArray:
        """The body of each vertex (V,)."""
        return np.repeat(np.arange(len(self.bodies)), np.diff(self.vertex_starts)).astype(np.int32)

    @cached_property
    def centred_rest(self) -> FloatArray:
        """The rest (V, 3), about its centre where it is far from the origin."""
        return about_centre(self.rest)[0]

    @cached_property
    def scale(self) -> Scale:
        """What lengths are measured in."""
        sets = np.array([body.of_set for body in self.bodies], dtype=bool)
        return scale_of(self.rest, self.vertex_starts, self.never_moves, sets=sets)

    @cached_property
    def never_moves(self) -> NDArray[np.bool_]:
        """Which bodies (B,) have no vertex that moves."""
        return np.asarray(np.bincount(self.body_of_vertex, self.mobility, len(self.bodies)) == 0.0)

    @cached_property
    def detector(self) -> Detector:
        """Detector of all bodies, built on their rest poses."""
        return Detector(self.centred_rest, self.faces, device=self.device)

    @cached_property
    def rest_weld(self) -> IntArray:
        """Vertices (V,) of one body at one position of the rest count as one, see touches."""
        rest, weld = self.centred_rest, self.weld(self.centred_rest)
        return without_touches(self.faces, weld, lambda: self.detector(rest, weld=weld))

    @cached_property
    def seams(self) -> Seams:
        """Vertices that are one point of the rest; across attached soft bodies, too."""
        if self.options.method == "paper":
            return NO_SEAMS
        soft = np.array([not body.rigid for body in self.bodies])[self.body_of]
        faces, owner = self.rest_weld[self.faces[soft]], self.body_of_vertex
        found = find_seams(self.centred_rest, faces, owner)
        # What lies at one place and is not one only touches there.
        first, second = self.weld(self.centred_rest)[found.vertices.T]
        found = found.chosen(first != second)
        across = self.attachments is not None and self.options.mode == "both"
        return found if across else found.chosen(~found.across(owner))

    @cached_property
    def rest_sewn(self) -> IntArray:
        """Vertices (V,) at one position of the rest count as one, across closed seams too."""
        return sewn(self.rest_weld, self.seams, self.centred_rest)

    @cached_property
    def edges_of_bodies(self) -> list[IntArray]:
        """Edges (E, 2) of each body, numbered within it."""
        ends = zip(pairwise(self.triangle_starts), self.vertex_starts, strict=False)
        return [unique_edges(self.faces[a:b] - start) for (a, b), start in ends]

    @cached_property
    def enclosures(self) -> Enclosures:
        """Finds what lies wholly inside what."""
        return Enclosures(self.rest, self.rest_weld[self.faces])

    @cached_property
    def body_of_part(self) -> IntArray:
        """The body of each part of `enclosures`."""
        owner = np.zeros(self.enclosures.count, dtype=np.int32)
        used = self.enclosures.part >= 0
        owner[self.enclosures.part[used]] = self.body_of_vertex[used]
        return owner

    @cached_property
    def rigid(self) -> RigidBodies:
        """The bodies that move as a whole only."""
        ranges = zip(pairwise(self.vertex_starts.tolist()), self.bodies, strict=True)
        chosen = [own for own, body in ranges if body.rigid]
        return RigidBodies(chosen, np.ones(len(self.rest)))

    @cached_property
    def attachments(self) -> Attachments | None:
        """What was modelled as overlapping; None where nothing was.

        Unless the options take modelled contacts as such, only what the user calls attached.
        """
        if self.options.method == "paper":
            return None
        auto = self.options.rest_contacts == "auto"
        references = telling(self.references, auto=auto, turns=self.turns)
        if not references:
            return None
        poses = [self.rest, *(pose.points for pose in self.layer_poses)]
        return known_attachments(self.rest_weld[self.faces], references, poses)

    def changed(self, *forgotten: str, **changes: Any) -> Scene:
        """Return the same with other fields; what is known stays so, but what is `forgotten`."""
        other, asked = replace(self, **changes), {field.name for field in fields(self)}
        known = vars(self).keys() - asked - {"turning", *forgotten}
        vars(other).update({name: getattr(self, name) for name in known})
        return other

    @cached_property
    def turning(self) -> Scene | None:
        """The same with joints that turned left alone; None where no joint turns so far."""
        if self.turns or not any(reference.turned for reference in self.references):
            return None
        own, other = self.attachments, replace(self, turns=True)
        shared = ("detector", "enclosures", "rest_weld", "strain_meter", "layers", "covering")
        vars(other).update({name: getattr(self, name) for name in shared})
        return None if own is None or own.same_zones(other.attachments) else other

    @cached_property
    def held(self) -> Attachments | None:
        """The attachments without the ties that the clip lets go, with those of garments."""
        known = self.attachments
        if known is not None and known.tied:
            known = known.holding(ties_that_hold(self.strain_meter, known, self.layer_poses))
        if not self.dressed:
            return known
        return (known or no_attachments(self.enclosures.part_of_face)).carrying(self.garments)

    @cached_property
    def garments(self) -> Ties:
        """What holds garments to what they lie over, doubly where an attachment does already."""
        poses = [self.centred_rest, *(pose.points for pose in self.layer_poses)]
        return garment_ties(self.covering, self.enclosures.faces, poses)

    @cached_property
    def strain_meter(self) -> StrainMeter:
        """Measures what a correction does to the shapes of the bodies."""
        parts = ConnectedParts(self.rest_weld[self.faces], self.body_of_vertex, self.attachments)
        shown = [reference.points for reference in self.references if reference.shows_all]
        stiff = [part for part, body in enumerate(self.body_of_part) if self.is_stiff(body)]
        rings = Rings(self.layers.parts, stiff) if self.enclosures.count > 1 else None
        known = partial(StrainMeter, rest=self.centred_rest, scale=self.scale, options=self.strain)
        crossed = parts.crossed(self.detector(self.centred_rest, weld=self.rest_weld))
        return known(parts, references=shown, crossed=crossed, rings=rings)

    @cached_property
    def layers(self) -> Layers:
        """Which connected parts lie over which, numbered as in `enclosures`."""
        known, own = self.layer_poses, self.enclosures
        if not known:
            every = self.detector(self.centred_rest, weld=self.rest_weld)
            known = (Reference(self.rest, every),)
        parts = Parts(own.faces, own.part, own.closed, [pose.points for pose in known])
        pairs = [self.attached_parts.unmodelled(pose.pairs) for pose in known]
        zone = self.attached_parts.zone
        return Layers(parts, pairs, numbers=self._layer_numbers(), zone=zone)

    @cached_property
    def covering(self) -> Covering | None:
        """What open layers cover; None where there are none. The published method knows none."""
        own = self.enclosures
        if self.options.method == "paper" or own.count < 2 or own.closed.all():
            return None
        found = open_layers(self.layers)
        return found and found.of_vertices(self.rest_weld, np.arange(len(self.rest)))

    @property
    def worn(self) -> list[tuple[int, int]]:
        """Parts of `enclosures` that count as worn, each over another; not what the user told.

        Of open parts only, the largest first: `covering` has looked at them anyway.
        """
        if self.covering is None:
            return []
        both = [(layer.top, layer.under) for layer in learnt_layers(self.layers)]
        counted = self.counted(self.body_of_part[np.array(both, np.int32).reshape(-1, 2)])
        return [own for own, counts in zip(both, counted.tolist(), strict=True) if counts]

    @cached_property
    def attached_parts(self) -> AttachedParts:
        """What the parts of `enclosures` have to do with each other by attachments."""
        return AttachedParts(self.attachments, self.enclosures.faces, self.enclosures.part)

    def _layer_numbers(self) -> IntArray:
        """How far out each part lies: the median of what its triangles are told, 0 if nothing."""
        counts = np.diff(self.triangle_starts).tolist()
        told = [layer_of(*both) for both in zip(self.bodies, counts, strict=True)]
        own = self.enclosures
        return median_of_parts(np.concatenate(told), own.part_of_face, own.count)

    @cached_property
    def rest_pairs(self) -> IntArray:
        """Intersecting pairs (K, 2) of the rest poses themselves that count."""
        return self.pairs(self.centred_rest, self.rest_weld)

    @cached_property
    def rest_intersections(self) -> int:
        """Number of intersecting triangles of the rest poses themselves."""
        return triangle_count(self.rest_pairs)

    def is_stiff(self, body: int) -> bool:
        """Return whether a body hardly changes its shape: rigid, or diffused very widely."""
        own = self.bodies[body]
        return own.rigid or (own.diffusion or self.options.diffusion) >= STIFF

    def vertices_of(self, body: int) -> slice:
        """Return the vertices of a body."""
        return slice(int(self.vertex_starts[body]), int(self.vertex_starts[body + 1]))

    def triangles_of(self, body: int) -> slice:
        """Return the triangles of a body."""
        return slice(int(self.triangle_starts[body]), int(self.triangle_starts[body + 1]))

    def gather(self, points: Sequence[Any]) -> FloatArray:
        """Return poses (V, 3) of each body as one; ValueError for wrong shapes or numbers."""
        if len(points) != len(self.bodies):
            raise ValueError(f"points should hold {len(self.bodies)} poses, got {len(points)}")
        both = zip(points, np.diff(self.vertex_starts).tolist(), strict=True)
        return np.concatenate([points_of(pose, count) for pose, count in both])

    def weld(self, points: FloatArray) -> IntArray:
        """Return the vertex (V,) that stands for each: one where those of a body coincide."""
        with np.errstate(over="ignore"):  # the detector tells what is beyond float32
            return weld_maps([points[a:b] for a, b in pairwise(self.vertex_starts)])

    def sewn(self, points: FloatArray, weld: IntArray) -> IntArray:
        """Return the vertex (V,) that stands for each: as `weld` (V,), across closed seams too."""
        return sewn(weld, self.seams, points)

    def pairs(self, points: FloatArray, weld: IntArray) -> IntArray:
        """Return the intersecting pairs (K, 2) of a pose (V, 3), exact on float32 coordinates.

        Of contacts that count, so of no modelled ones; `weld` (V,): vertices that count as one.
        """
        pairs = self.detector(points, weld=weld, zones=self._zones)
        return self.unmodelled(pairs[self.counted(self.body_of[pairs])])

    @cached_property
    def _zones(self) -> Any:
        return self.detector.zones_of(self.attachments)

    def unmodelled(self, pairs: IntArray) -> IntArray:
        """Return which of pairs (K, 2) of triangles are no modelled contacts."""
        return pairs if self.attachments is None else pairs[~self.attachments.modelled(pairs)]

    def enclosed_parts(self, points: FloatArray, pairs: IntArray) -> IntArray:
        """Return the parts (K, 2) of a pose wholly inside others, and not so at rest.

        `pairs` (K, 2): the intersecting pairs of the pose. Of contacts that count only.
        """
        found = self.enclosures(points, pairs)
        parts = found.parts[~found.meant]
        parts = parts[self.counted(self.body_of_part[parts])]
        return parts[~self.attached_parts.meant_inside(parts, points, self.enclosures)]

    def counted(self, bodies: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Return which contacts (K,) count, given by the two bodies (K, 2) that they join."""
        return counted_between(bodies, mode=self.options.mode, ignored=self.ignored)
