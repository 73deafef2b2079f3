"""From when on a result is strained, and what is beyond such a bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import IntArray


@dataclass(frozen=True, kw_only=True)
class StrainOptions:
    """From when on a result is strained; lengths are fractions of the diagonal of the input.

    Args:
        factor: An edge is spoilt if it got longer or shorter by more: texture and skin are smeared
            or crushed there.
        edges: So many spoilt edges may be in a part, and in a body: a crease has a few, and nobody
            sees them.
        edges_share: Or this share of the edges, if that is more.
        point: Edges shorter than this before and after are points: rounding changes their length.
        drift: An attached vertex may move so far off its place on the other part: an eye or a cuff
            seen from near comes off.
        larger: What sits on a part of so many times its area, and was led off by more than `joint`,
            may go back to where it was modelled by any way: a pouch that sank into a vest is led
            out.
        loose: So far, where something would be left else, what the input itself has led off its
            place, as hair that a turned head leads off a shoulder: it rests there no more.
        slide: 95 % of all attached vertices move less: what slides more looks loose all over.
        aim: Relief goes on to this part of it: who measures at other vertices finds a little more.
        joint: 95 % of those between the same two parts: one joint is few of all vertices. What slid
            farther from the rest in the input itself, as hair over a shoulder, is no joint there.
            Where something would be left else it may slide as far as `drift`.
        volume: Change of the volume of a closed part: flesh that swells or shrivels more is seen.
        thicker: Of what has more volume, growth of the volume over the area: a ring that is widened
            to go round an arm has more of both, and did not swell. Attached lumps without a hole,
            as the pieces of a finger, go round nothing: they swell however thin they are.
        sheet: A closed part of less volume, over its area to the power 3/2, is a sheet, which has
            none to keep. A ball has 0.094, a plate of 1 x 1 x 0.01 0.003.
        limb: Change of the volume of a piece of a limb within a skin: good results of limbs that
            were inside each other have some that lose 64 %, a crumpled hand loses 79 %.
        wire: The same of short pieces: good results have some that lose 74 %, wires 79 to 95 %.
        patch: Width of a connected patch of triangles that turned over: creases of good results of
            deep contacts have some up to 0.026, and half a hand is 0.04 wide.
        patch_share: Or this share of the area of the part, if that is less: an eye is small.
        patch_triangles: A patch of so few triangles is a crease of a coarse mesh.
        patch_rolls: Of a larger share of its part a patch may have rolled, as a strap does; an
            inside of a mouth, which is smoother turned out, is smaller.
        worn: How many times less what a ring goes round may pass through it than in the input.
    """

    factor: float = 4.0
    edges: int = 5
    edges_share: float = 0.0005
    point: float = 1e-5
    drift: float = 0.02
    larger: float = 10.0
    loose: float = 0.04
    slide: float = 0.004
    aim: float = 0.85
    joint: float = 0.01
    volume: float = 0.2
    thicker: float = 0.02
    sheet: float = 0.002
    limb: float = 0.7
    wire: float = 0.75
    patch: float = 0.035
    patch_share: float = 0.25
    patch_triangles: int = 5
    patch_rolls: float = 0.1
    worn: float = 0.5


class Excess(NamedTuple):
    """A measure beyond its bound, of a part; the worst vertex, all concerned, what it came off."""

    kind: StrainKind
    part: int
    value: float
    bound: float
    worst: int
    vertices: IntArray
    other: int = -1
