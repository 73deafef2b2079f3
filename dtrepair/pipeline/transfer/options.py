"""How a motion is transferred, as one object."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dtrepair.pipeline.errors import UsageError

UP_AXES = ("Y", "Z")
ALIGNMENTS = ("axes", "rests")


@dataclass(frozen=True, kw_only=True)
class TransferOptions:
    """How a motion is transferred; UsageError where two choices do not go together.

    Without `markers` and `correspondence` both meshes have the same topology.

    Args:
        markers: file of vertex pairs: .cons, two columns of text, or npz; of several meshes those
            of the largest on either side.
        match: texts "A,B" or "A,B=FILE": the target's mesh B follows the source's mesh A, of the
            same topology or with a file of markers.
        correspondence: file of triangle pairs: .tricorrs, text, or npz; several meshes are numbered
            one after the other.
        save_correspondence: npz or text file to write the triangle pairs to.
        target_prim: path expression of the target's meshes, where not all are meant.
        source_up: up axis of the source, Y or Z; None: as its stage says, or as the target's.
        target_up: likewise of the target.
        align: turn the motion as the up "axes" lie to each other, or as the "rests" do.
        root_scale: scale of the travel; None: the ratio of the heights.
        ground: keep the lowest vertex on the source's ground.
        pin: target vertices that stay at rest: name of a primvar or GeomSubset, or an npz of
            `vertices` and `positions`.
        registration: PNG to draw the registered source over the target to.
        shapes: take the poses as shapes, and write UsdSkel blend shapes.
    """

    markers: str | None = None
    match: tuple[str, ...] = ()
    correspondence: str | None = None
    save_correspondence: str | None = None
    target_prim: str | None = None
    source_up: str | None = None
    target_up: str | None = None
    align: str = "axes"
    root_scale: float | None = None
    ground: bool = False
    pin: str | None = None
    registration: str | None = None
    shapes: bool = False

    def __post_init__(self) -> None:
        """Check the choices."""
        if self.align not in ALIGNMENTS:
            raise UsageError(f"align should be one of {', '.join(ALIGNMENTS)}, got {self.align!r}")
        for name in ("source_up", "target_up"):
            if getattr(self, name) not in (None, *UP_AXES):
                known = ", ".join(UP_AXES)
                raise UsageError(f"{name} should be one of {known}, got {getattr(self, name)!r}")
        if self.root_scale is not None and not 0.0 <= self.root_scale < math.inf:
            raise UsageError(f"root_scale should be at least 0 and finite, got {self.root_scale}")
        if self.markers and self.correspondence:
            raise UsageError("--markers, --correspondence: give one of them")
        if self.match and self.correspondence:
            raise UsageError("--match, --correspondence: give one of them")
        if self.ground and self.pin:
            raise UsageError("--ground: has no effect on pinned frames; leave out it or --pin")
        if self.shapes and self.pin:
            raise UsageError("--pin: has no effect with --shapes; leave it out")
