"""The objects of a scene, and the space they are repaired in."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dtrepair.numerics.geometry import (
    FloatArray,
    IntArray,
    as_mesh,
    as_numpy,
    as_points,
    diagonal,
    extent,
)

# Poses farther from the origin than this many times their size are repaired about their centre:
# float32 would lose too many digits there.
FAR_FROM_ORIGIN = 16.0
# From this diffusion on a body of a scene is stiff: it is led as a whole, and keeps its shape.
STIFF = 300.0
# Largest clearance, part of the diagonal: with a larger one everything is close to everything.
WIDEST_CLEARANCE = 0.05


@dataclass(frozen=True, eq=False)
class Body:
    """One object of a scene.

    Args:
        rest: Rest positions (V, 3), length units of the scene.
        faces: Triangles (F, 3).
        diffusion: lambda of this body: higher moves it more as one piece; None: the option's.
        mobility: 0 never moves (a collider), 1 moves freely.
        pin: 0 free to 1 fixed for each vertex (V,).
        direction: Preferred direction (V, 3) of the repair, zero rows where none.
        name: What messages call it; default: its number.
        rigid: It moves as a whole only; a fixed vertex then holds all of it.
        layer: Whole numbers (F,), one for each triangle: a higher one lies farther out; None:
            nobody says.
        of_set: It is of the set around what moves, by which no lengths are measured.
        prop: A transform carries it, beside bodies that bend: it is rigid where that leaves no
            more than bending it does, unless it is worn, or attached to another body.
        bends: The user says that it is not rigid: it bends, however it moves in the input.

    Raises:
        ValueError: diffusion or mobility out of range. What must fit the mesh, a scene checks.
    """

    rest: ArrayLike
    faces: ArrayLike
    diffusion: float | None = None
    mobility: float = 1.0
    pin: ArrayLike | None = None
    direction: ArrayLike | None = None
    rigid: bool = False
    name: str = ""
    layer: ArrayLike | None = None
    of_set: bool = False
    prop: bool = False
    bends: bool = False

    def __post_init__(self) -> None:
        """Check the numbers that stand for the whole body."""
        if not 0.0 <= _number(self.mobility) <= 1.0:
            raise ValueError(
                f"mobility should be a number from 0, never moves, to 1, got {self.mobility!r}; "
                "what differs from vertex to vertex is a pin"
            )
        if self.diffusion is not None and not 0.0 < _number(self.diffusion) < np.inf:
            raise ValueError(
                f"diffusion should be positive and finite, got {self.diffusion!r}: "
                "None takes that of the options"
            )


def _number(value: Any) -> float:
    """Return a value as a number, NaN if it is none."""
    try:
        return np.nan if isinstance(value, str) else float(value)
    except (TypeError, ValueError):
        return np.nan


class Absent(NamedTuple):
    """A body that is not there in a pose, as one that is hidden: it meets nothing.

    points: Where it would be (V, 3); it comes back as it is. placed: else only its shape.
    """

    points: Any
    placed: bool = True


def points_of(pose: Any, count: int) -> FloatArray:
    """Return the points (V, 3) of a body in a pose; ValueError for wrong shapes or numbers."""
    return as_points(as_numpy(pose.points if isinstance(pose, Absent) else pose), count)


def mobility_of(body: Body, count: int) -> FloatArray:
    """Return how freely each vertex (count,) moves, 0 to 1.

    Raises:
        ValueError: wrong pins.
    """
    if body.pin is None:
        return np.full(count, body.mobility)
    pin = np.asarray(body.pin, dtype=np.float64)
    if pin.shape != (count,) or not ((pin >= 0) & (pin <= 1)).all():
        raise ValueError(f"pin should hold {count} numbers between 0 and 1, got {pin.shape}")
    mobility = body.mobility * (1.0 - pin)
    return np.full(count, mobility.min(initial=1.0)) if body.rigid else mobility


def direction_of(body: Body, count: int) -> FloatArray:
    """Return the preferred direction (count, 3), zero rows where none; ValueError if malformed."""
    if body.direction is None:
        return np.zeros((count, 3))
    direction = np.asarray(body.direction, dtype=np.float64)
    if direction.shape != (count, 3) or not np.isfinite(direction).all():
        raise ValueError(f"direction should be finite, shape ({count}, 3), got {direction.shape}")
    return direction


def layer_of(body: Body, count: int) -> IntArray:
    """Return how far out each triangle (count,) lies, 0 where nobody says.

    Raises:
        ValueError: another number of triangles, or numbers that are not whole.
    """
    if body.layer is None:
        return np.zeros(count, dtype=np.int32)
    layer = np.asarray(body.layer)
    if layer.shape != (count,) or layer.dtype.kind not in "iu":
        raise ValueError(
            f"layer should hold a whole number for each of {count} triangles, got {layer.dtype} of "
            f"shape {layer.shape}"
        )
    return layer.astype(np.int32)


def checked_meshes(bodies: Sequence[Body]) -> list[tuple[FloatArray, IntArray]]:
    """Return the rest positions (V, 3) and triangles (F, 3) of each body.

    Raises:
        ValueError: no bodies, or one that cannot be used.
    """
    if not bodies:
        raise ValueError("bodies should hold at least one body, got none")
    meshes = [as_mesh(body.rest, body.faces) for body in bodies]
    for number, (body, (points, faces)) in enumerate(zip(bodies, meshes, strict=True)):
        if len(points) == 0 and len(bodies) > 1:
            raise ValueError(
                f"bodies of a scene should have a vertex at least, got none in "
                f"{body.name or f'body {number}'}: leave it out, and its poses"
            )
        layer_of(body, len(faces))
    return meshes


def widest_clearance(rest: FloatArray) -> float:
    """Return the widest clearance that there may be for rest positions (V, 3) of all bodies."""
    return WIDEST_CLEARANCE * diagonal(rest)


def check_clearance(clearance: float, rest: FloatArray) -> None:
    """Refuse a clearance that is too wide for rest positions (V, 3) of all bodies: ValueError."""
    most = widest_clearance(rest)
    if clearance > most > 0.0:
        raise ValueError(
            f"clearance should be at most {most:.4g}, {WIDEST_CLEARANCE:.0%} of the diagonal of "
            f"the rest poses, got {clearance:.4g}"
        )


def checked_ignored(ignore: Iterable[tuple[int, int]], count: int) -> tuple[tuple[int, int], ...]:
    """Return pairs (i, j), i <= j, of bodies, each once.

    Raises:
        ValueError: bodies that are not there.
    """
    pairs = {(min(i, j), max(i, j)) for i, j in ignore}
    for pair in pairs:
        if not 0 <= pair[0] <= pair[1] < count:
            raise ValueError(f"ignore should hold pairs of bodies 0 to {count - 1}, got {pair}")
    return tuple(sorted(pairs))


def about_centre(points: FloatArray) -> tuple[FloatArray, FloatArray | float]:
    """Return points about the origin and the centre they had; 0 where float32 holds them well."""
    if not len(points):
        return points, 0.0
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    if np.abs(centre).max() <= FAR_FROM_ORIGIN * extent(points):
        return points, 0.0
    return points - centre, centre
