"""The colours of meshes in pictures and in the window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Colour = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Colours:
    """Red, green and blue, 0 to 1.

    Args:
        surface: Of the outside: a warm grey, beside which the others stand out.
        intersecting: Of intersecting triangles.
        modelled: Of triangles that intersect as they were modelled: calm, they are no faults.
        back: Of the inside, seen where a surface is open or inside out.
        background: Behind everything.
        objects: Of further objects, the first being `surface`; then again from the start, but
        darker: by this factor.
    """

    surface: Colour = (0.78, 0.75, 0.71)
    intersecting: Colour = (0.90, 0.09, 0.07)
    modelled: Colour = (0.80, 0.88, 0.97)
    back: Colour = (0.30, 0.45, 0.85)
    background: Colour = (250 / 255, 250 / 255, 252 / 255)
    objects: tuple[Colour, ...] = (
        (0.55, 0.69, 0.72),
        (0.82, 0.70, 0.45),
        (0.62, 0.72, 0.52),
        (0.70, 0.60, 0.74),
        (0.55, 0.60, 0.66),
        (0.74, 0.62, 0.55),
        (0.80, 0.78, 0.60),
    )

    darker: float = 0.78

    def of(self, numbers: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the colours (N, 3) of objects by their numbers (N,)."""
        palette = np.asarray((self.surface, *self.objects), dtype=np.float64)
        again, place = np.divmod(np.asarray(numbers), len(palette))
        # The third darkening and those after it are hard to tell from black.
        colours: NDArray[np.float64] = palette[place] * self.darker ** (again % 4)[:, None]
        return colours
