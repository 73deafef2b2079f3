"""A dressed limb that bends, made in code: a body, a sleeve on it, and two eyes in its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.meshes import Mesh, icosphere, swept

# Half the length of the limb that bends; where the sleeve begins and ends; where the eyes are.
JOINT, SLEEVE, EYES = 0.25, (0.3, 0.75), 0.9


@dataclass(frozen=True)
class Limb:
    """How finely a limb is made, and how thick."""

    around: int
    along: int
    radius: float

    def body(self, bend: float) -> Mesh:
        """A closed tube of length 2, bent by an angle over its joint."""
        s = np.linspace(-1.0, 1.0, self.along + 1)
        return swept(centres(s, bend), np.full(len(s), self.radius), self.around, closed=False)

    def sleeve(self, bend: float) -> Mesh:
        """An open tube on the bent half, a fifth wider than the body."""
        # Rings before it carry the frame of the whole limb along; they and both caps are left out.
        before = self.along
        own = np.linspace(*SLEEVE, self.along // 3)
        s = np.concatenate([np.linspace(-1.0, SLEEVE[0], before, endpoint=False), own])
        wide = np.full(len(s), 1.2 * self.radius)
        points, faces = swept(centres(s, bend), wide, self.around, closed=False)
        first, last = before * self.around, len(s) * self.around
        kept = ((faces >= first) & (faces < last)).all(axis=1)
        return points[first:last], faces[kept] - first

    def eyes(self, bend: float) -> Mesh:
        """Two small balls, each half in the surface."""
        ball, faces = icosphere(1, 0.25 * self.radius)
        across = np.array([[np.cos(bend), 0.0, -np.sin(bend)], [0.0, 1.0, 0.0]])
        turn = np.stack([across[0], across[1], [np.sin(bend), 0.0, np.cos(bend)]])
        middle = centres(np.array([EYES]), bend)[0]
        sides = [middle + self.radius * side * across[1] for side in (1.0, -1.0)]
        points = np.concatenate([ball @ turn + side for side in sides])
        return points, np.concatenate([faces, faces + len(ball)]).astype(np.int32)

    def marked(self) -> NDArray[np.int64]:
        """Vertices of the body at the same places of every limb: four on a ring, and its ends."""
        rings = np.round(np.linspace(0, self.along, 9)).astype(int)
        quarters = np.arange(4) * self.around // 4
        ends = (self.along + 1) * self.around + np.arange(2)
        return np.concatenate([(rings[:, None] * self.around + quarters).ravel(), ends])


def centres(s: NDArray[np.float64], bend: float) -> NDArray[np.float64]:
    """The axis (N, 3) at arc lengths s from -1 to 1; it begins along z, and turns towards x."""
    fine = np.linspace(-1.0, 1.0, 4001)
    heading = bend * np.clip((fine + JOINT) / (2.0 * JOINT), 0.0, 1.0)
    middle = 0.5 * (heading[1:] + heading[:-1])
    step = np.stack([np.sin(middle), np.zeros(4000), np.cos(middle)], axis=1) * (2.0 / 4000)
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(step, axis=0)])
    return np.stack([np.interp(s, fine, path[:, axis]) for axis in range(3)], axis=1)
