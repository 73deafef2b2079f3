"""Small shapes for each bound of a repair: as they were, just within it, and just beyond it.

Metres: they are parts of a character whose bounding box has a diagonal of 2 m, as that of an adult
with lowered arms has. Of that character the corners of the box are there, and not drawn.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.dressed_shapes import closed, revolved, smooth
from dtrepair.diagnosis import StrainKind
from examples.shapes import Mesh, tube

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
Mask = NDArray[np.bool_]
# Triangles at opposite corners of its box of 3 x 6 x 2 lengths, whose diagonal has 7.
_CORNER = np.array([3.0, 6.0, 2.0]) / 7.0
_CHIP = 0.01 * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
CHARACTER: Mesh = (
    np.concatenate([_CHIP - _CORNER, _CORNER - _CHIP]),
    np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32),
)
# What triangles are painted with, by the order of the palette that draws them.
SKIN, CLOTH, DARK_SKIN, DARK_CLOTH, WHITE, DARK = range(6)
AROUND = 48


@dataclass(frozen=True, kw_only=True)
class Example:
    """Shapes that show one measure, and what some harm makes of them.

    row, bound: words of its row of the table in docs/characters.md: the measure, and the bound.
    caption: with its bound, {0} as the meter has it, {1} in centimetres. value: the same of what
    is measured.
    paint: a number for each triangle (F,) of all meshes. pose: the points of each mesh by the
    harm; within, beyond: how much of it.
    marked: the triangles (F,) to mark, by the points before and after; None: all that the meter
    finds concerned.
    look: azimuth and elevation in degrees. centre: of the picture; wide: half of its width.
    """

    kind: StrainKind
    row: str
    bound: str
    caption: str
    value: str = "{1:.1f} cm"
    meshes: Sequence[Mesh]
    paint: Numbers
    pose: Callable[[float], list[Floats]]
    within: float
    beyond: float
    marked: Callable[[list[Floats], list[Floats]], Mask] | None = None
    look: tuple[float, float] = (0.0, 15.0)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wide: float = 0.16


def painted(mesh: Mesh, colour: int) -> Numbers:
    """All triangles of a mesh in one colour."""
    return np.full(len(mesh[1]), colour)


def chequered(mesh: Mesh, around: int, size: int, colours: tuple[int, int]) -> Numbers:
    """Squares of a tube in two colours by turns; its ends have the first.

    size: edges of a square.
    """
    quads = len(mesh[1]) // 2 - around
    quad = np.arange(2 * quads) % quads
    odd = (quad // around // size + quad % around // size) % 2
    return np.concatenate([np.asarray(colours)[odd], np.full(2 * around, colours[0])])


def middles(meshes: Sequence[Mesh], points: Sequence[Floats]) -> Floats:
    """The middles (F, 3) of the boxes of triangles, alike for both of a quad."""
    pairs = zip(meshes, points, strict=True)
    corners = np.concatenate([own[faces] for (_, faces), own in pairs])
    return np.asarray(0.5 * (corners.min(axis=1) + corners.max(axis=1)))


def arm_radius(x: Floats) -> Floats:
    """How thick an arm is, but for its hand."""
    flesh = 0.006 * np.exp(-(((x + 0.02) / 0.07) ** 2))
    return np.asarray(0.034 + 0.014 * smooth(-x, -0.1, 0.3) + flesh)


def arm_along(x: Floats) -> Mesh:
    """An arm along x, with a ring at each place, that ends in a mitten."""
    share = np.clip(np.minimum(x - x[0], x[-1] - x) / 0.06, 0.001, 1.0)
    radius = arm_radius(x) + 0.012 * np.exp(-(((x - 0.27) / 0.05) ** 2))
    radius = radius * np.sqrt(1.0 - (1.0 - share) ** 2)
    points, faces = tube(np.stack([x, 0.0 * x], axis=1), radius, AROUND)
    flat = smooth(points[:, 0], 0.17, 0.26)
    return points * np.stack([1.0 + 0.0 * flat, 1.0 + 0.1 * flat, 1.0 - 0.35 * flat], axis=1), faces


def moved_most(meshes: Sequence[Mesh]) -> Callable[[list[Floats], list[Floats]], Mask]:
    """Marks what went more than a third as far as what went farthest."""

    def marked(before: list[Floats], after: list[Floats]) -> Mask:
        moved = np.linalg.norm(middles(meshes, after) - middles(meshes, before), axis=1)
        return np.asarray(moved > moved.max() / 3.0)

    return marked


def crushed_edges() -> Example:
    """An elbow; a row of its edges gets shorter than a quarter."""
    around, row = 24, 22
    bend = np.radians(50.0) * (np.asarray(smooth(np.linspace(-1.0, 1.0, 45), -0.3, 0.3)) - 0.5)
    line = np.cumsum(np.stack([np.cos(bend), np.sin(bend)], axis=1), axis=0) * 0.0115
    elbow = tube(line - line[row], 0.042, around)

    def pose(harm: float) -> list[Floats]:
        points = elbow[0].copy()
        own = row * around + around // 6 + np.arange(int(harm)) - int(harm) // 2
        points[own] = points[own + around] + 0.24 * (points[own] - points[own + around])
        return [points]

    return Example(
        kind=StrainKind.EDGES,
        row="edges more than four times longer or shorter",
        bound="5",
        caption="edges: at most {0:.0f} crushed",
        value="{0:.0f}",
        meshes=[elbow],
        paint=chequered(elbow, around, 1, (SKIN, DARK_SKIN)),
        pose=pose,
        within=5,
        beyond=6,
        look=(0.0, 35.0),
        wide=0.085,
    )


def swollen_belly() -> Example:
    """A closed trunk whose belly swells."""
    around = 96
    turn = np.linspace(0.1, 1.5, 16)
    hips = list(zip(-0.16 - 0.08 * np.cos(turn), 0.02 + 0.11 * np.sin(turn), strict=True))
    waist = [(y, 0.13 - 0.014 * np.cos(10.5 * y)) for y in np.linspace(-0.15, 0.14, 50)]
    neck = list(zip(0.15 + 0.08 * np.sin(turn), 0.05 + 0.078 * np.cos(turn), strict=True))
    top = [(0.245, 0.05), (0.265, 0.05), (0.27, 0.045), (0.272, 0.01)]
    trunk = closed(revolved([*hips, *waist, *neck, *top], around, wide=1.25, deep=0.85), around)
    points = trunk[0]

    def pose(harm: float) -> list[Floats]:
        belly = np.exp(-(((points - [0.0, -0.05, 0.13]) / [0.14, 0.13, 0.16]) ** 2).sum(axis=1))
        return [points + harm * belly[:, None] * [0.0, -0.15, 1.0]]

    return Example(
        kind=StrainKind.VOLUME,
        row="change of the volume of a closed part",
        bound="20 %",
        caption="volume: at most {0:.0%} more or less",
        value="{0:.0%}",
        meshes=[trunk],
        paint=chequered(trunk, around, 4, (SKIN, DARK_SKIN)),
        pose=pose,
        within=0.117,
        beyond=0.127,
        marked=moved_most([trunk]),
        look=(65.0, 10.0),
        wide=0.44,
    )


def pinched_arm() -> Example:
    """An arm that lost its flesh between elbow and wrist."""
    arm = arm_along(np.linspace(-0.38, 0.34, 145))

    def pose(harm: float) -> list[Floats]:
        share = harm * np.exp(-(((arm[0][:, 0] - 0.045) / 0.058) ** 4))
        return [arm[0] * (1.0 - share[:, None] * [0.0, 1.0, 1.0])]

    return Example(
        kind=StrainKind.LIMB,
        row="the same of a piece of a limb",
        bound="70 %",
        caption="limb: at most {0:.0%} of a piece lost",
        value="{0:.0%}",
        meshes=[arm],
        paint=chequered(arm, AROUND, 4, (SKIN, DARK_SKIN)),
        pose=pose,
        within=0.5,
        beyond=0.54,
        look=(25.0, 15.0),
        centre=(0.08, 0.0, 0.0),
        wide=0.25,
    )


def turned_corner() -> Example:
    """The corner of a cape that is folded over."""
    wide, high, roll = 0.42, 0.3, 0.01
    v, u = (k.ravel() for k in np.mgrid[-0.5:0.5:61j, -0.5:0.5:85j])
    cape = np.stack([wide * u, high * v, 0.012 * np.sin(9.0 * u + 1.0) * (0.6 - v)], axis=1)
    corner = (np.arange(60)[:, None] * 85 + np.arange(84)).ravel()
    sides = [(corner, corner + 1, corner + 86), (corner, corner + 86, corner + 85)]
    faces = np.concatenate([np.stack(side, axis=1) for side in sides]).astype(np.int32)
    squares = (corner // 85 // 4 + corner % 85 // 4) % 2
    across = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)

    def pose(harm: float) -> list[Floats]:
        end = np.array([0.5 * wide, -0.5 * high, 0.0]) @ across
        past = np.maximum(cape @ across - end + harm, 0.0)
        angle = np.minimum(past / roll, np.pi)
        back = roll * np.sin(angle) - np.maximum(past - np.pi * roll, 0.0) - past
        lift = roll * (1.0 - np.cos(angle))
        return [cape + back[:, None] * across + lift[:, None] * [0.0, 0.0, 1.0]]

    return Example(
        kind=StrainKind.FLIPS,
        row="width of a connected patch",
        bound=".035",
        caption="flips: at most {0:.2g}, here {1:.0f} cm",
        meshes=[(cape, faces)],
        paint=np.tile(np.where(squares, DARK_CLOTH, CLOTH), 2),
        pose=pose,
        within=0.088,
        beyond=0.0905,
        look=(25.0, 5.0),
        centre=(0.09, -0.075, 0.0),
    )
