"""The colours of meshes in pictures and in the window."""

from __future__ import annotations

from dataclasses import dataclass

Colour = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Colours:
    """Red, green and blue, 0 to 1.

    Args:
        surface: Of the outside: a warm grey, beside which the others stand out.
        intersecting: Of intersecting triangles.
        back: Of the inside, seen where a surface is open or inside out.
        background: Behind everything.
    """

    surface: Colour = (0.78, 0.75, 0.71)
    intersecting: Colour = (0.90, 0.09, 0.07)
    back: Colour = (0.30, 0.45, 0.85)
    background: Colour = (250 / 255, 250 / 255, 252 / 255)
