"""Numbers of attachments: how far zones reach, and what is attached as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from dtrepair.numerics.attached.hems import HemOptions


@dataclass(frozen=True, kw_only=True)
class AttachmentOptions:
    """How far a zone reaches, and what is attached as a whole.

    Args:
        reach: Geodesic growth of a zone beyond the overlap, in rms sizes of the overlap: a joint
            that bends slides by about that much. A zone begins within an edge of the mesh at least.
        rings: A triangle belongs to a zone if it begins there, and lies wholly within the rms sizes
            or within so many edges of the overlap.
        enclosed: Behind a part lies only what it encloses by this winding number, as a sleeve its
            arm: not all that is in front of a sheet.
        hangs: Beyond the reach of where the two meet, what hangs farther off one with a border than
            this share of what is behind it there is not held: the knees under a skirt.
        cells: Along the extent of a part, for its winding numbers: a sleeve is narrow.
        whole: A part of which more than this share is in or behind one of larger area is attached
            as a whole: eyes, teeth, buttons.
        larger: Ratio of areas above which that is so: copies of a part differ by rounding only.
        beside: The zone of what holds such a part reaches so many of its longest sides beyond the
            overlap: an eye turns in its head, but does not go into a paw of the same skin.
        small, covered: In one with a border that is so only of what has less than this share of its
            area, or of which more than this share is within the reach of where the two meet: a leg
            that grazes its robe at the hip may not come out of it at the knee.
        turned: Where rigid parts turn about each other, and in some pose more than this share of
            their contact has left the zone, it moves along; else small motions bring it back.
        nested: Of two parts that meet a third one where more than this share of what one has there
            is in the other, open one, as a finger in its glove beside a ring, the third tells
            nothing.
        garments: So many open parts, the largest, are asked what is in them.
        hems: What a garment does not hold that is attached by them only.
    """

    reach: float = 1.0
    rings: int = 3
    enclosed: float = 0.5
    hangs: float = 0.5
    cells: int = 64
    whole: float = 0.5
    larger: float = 1.001
    beside: float = 1.0
    small: float = 0.1
    covered: float = 0.75
    turned: float = 0.5
    nested: float = 0.25
    garments: int = 24
    hems: HemOptions = HemOptions()
