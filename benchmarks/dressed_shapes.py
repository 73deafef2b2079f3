"""The dressed characters of `benchmarks.dressed`: tubes and sheets, posed by a few joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
Faces = NDArray[np.int32]
Shape = tuple[Floats, Faces]
# Height and radius of rings from below.
Profile = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class Dressed:
    """A stage: meshes with poses (T, V, 3) each, the first being the rest; what is worn of them.

    cores: of each frame the middle lines (N, 3) of the limbs; loops: mesh, vertices round a limb.
    """

    meshes: dict[str, tuple[Floats, Faces]]
    cores: list[list[Floats]]
    loops: dict[str, list[list[int]]]


def smooth(value: Floats | float, low: float, high: float) -> Any:
    """0 below `low`, 1 above `high`, smooth between."""
    share = np.clip((np.asarray(value) - low) / (high - low), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)


def revolved(profile: Profile, around: int, *, wide: float = 1.0, deep: float = 1.0) -> Shape:
    """An open tube about the y axis, normals outwards."""
    angle = np.linspace(0.0, 2.0 * np.pi, around, endpoint=False)
    ring = np.stack([wide * np.sin(angle), np.zeros(around), deep * np.cos(angle)], axis=1)
    points = np.concatenate([radius * ring + (0.0, y, 0.0) for y, radius in profile])
    first = np.arange(len(profile) - 1)[:, None] * around
    near, far = (first + k % around for k in (np.arange(around), np.arange(around) + 1))
    corners = [(near, far, far + around), (near, far + around, near + around)]
    faces = [np.stack([k.ravel() for k in each], axis=1) for each in corners]
    return points, np.concatenate(faces).astype(np.int32)


def closed(shape: Shape, around: int) -> Shape:
    """An open tube with both ends closed by fans."""
    points, faces = shape
    last, count = len(points) - around, len(points)
    near = np.arange(around)
    far = (near + 1) % around
    ends = [points[:around].mean(axis=0), points[last:].mean(axis=0)]
    fans = [(near * 0 + count, far, near), (near * 0 + count + 1, last + near, last + far)]
    lids = [np.stack(fan, axis=1) for fan in fans]
    return np.concatenate([points, ends]), np.concatenate([faces, *lids]).astype(np.int32)


def turned(points: Floats, pivot: Sequence[float], axis: Sequence[float], angle: Floats) -> Floats:
    """Points (V, 3) turned about an axis through a pivot, each by an angle (V,)."""
    way = np.asarray(angle)[:, None] * np.asarray(axis, dtype=float)
    found: Floats = Rotation.from_rotvec(way).apply(points - pivot) + pivot
    return found


def joined(shapes: Sequence[Shape]) -> Faces:
    """The triangles of several shapes as one mesh."""
    starts = np.cumsum([0, *(len(points) for points, _ in shapes)])
    return np.concatenate([f + s for (_, f), s in zip(shapes, starts, strict=False)]).astype(
        np.int32
    )


LEG = closed(
    revolved(
        [(0.02, 0.01), (0.03, 0.05)]
        + [(y, 0.06 + 0.035 * float(smooth(y, 0.3, 0.9))) for y in np.linspace(0.06, 0.92, 40)]
        + [(0.97, 0.08), (1.0, 0.02)],
        32,
    ),
    32,
)
TORSO = closed(
    revolved(
        [(0.8, 0.02), (0.82, 0.12)]
        + [(y, 0.155 - 0.03 * float(smooth(y, 0.95, 1.2))) for y in np.linspace(0.86, 1.3, 20)]
        + [(1.33, 0.08), (1.34, 0.01)],
        48,
        wide=1.25,
        deep=0.85,
    ),
    48,
)


def skirt(frames: int = 24) -> Dressed:
    """Two legs that swing by 34 degrees through a skirt, which sways a little."""
    around = 64
    cloth, cloth_faces = revolved(
        [(y, 0.17 + 0.15 * (1.06 - y) / 0.62) for y in np.linspace(0.44, 1.06, 34)],
        around,
        wide=1.22,
        deep=0.98,
    )
    free = smooth(-cloth[:, 1], -0.95, -0.6)
    line = np.stack([np.zeros(30), np.linspace(1.2, 0.0, 30), np.zeros(30)], axis=1)
    bodies, cloths, cores = [], [], []
    for phase in np.linspace(0.0, 2.0 * np.pi, frames):
        parts, own = [TORSO[0]], list[Floats]()
        for side in (-1.0, 1.0):
            angle, hip = side * np.radians(34.0) * np.sin(phase), (side * 0.11, 0.88, 0.0)
            for points, kept in ((LEG[0], parts), (line, own)):
                placed = points + np.array([side * 0.11, 0.0, 0.0])
                swing = angle * smooth(-placed[:, 1], -0.95, -0.75)
                kept.append(turned(placed, hip, (1.0, 0.0, 0.0), swing))
        bodies.append(np.concatenate(parts))
        cores.append(own)
        sway = 0.02 * free * np.sin(phase + 0.5)
        cloths.append(cloth + sway[:, None] * np.array([0.0, 0.0, 1.0]))
    cloths[0] = cloth
    loops = [list(range(row * around, (row + 1) * around)) for row in (14, 24)]
    meshes = {
        "Body": (np.stack(bodies), joined([TORSO, LEG, LEG])),
        "Skirt": (np.stack(cloths), cloth_faces),
    }
    return Dressed(meshes, cores, {"Skirt": loops})


def cape(frames: int = 12) -> Dressed:
    """A body that bows and tilts its head; the hat follows the head, the cape the back, by less."""
    body = closed(
        revolved([(0.0, 0.02), *map(_figure, _heights()), (1.515, 0.01)], 56, wide=1.25, deep=0.9),
        56,
    )
    hat = revolved(
        [(1.36, 0.24)]
        + [(1.375, r) for r in np.linspace(0.22, 0.16, 5)]
        + [(y, 0.158 - 0.1 * (y - 1.38)) for y in np.linspace(1.4, 1.56, 10)]
        + [(1.57, 0.12), (1.575, 0.06), (1.576, 0.004)],
        56,
        wide=1.25,
        deep=0.95,
    )
    sheet = _sheet(45, 36)
    line = np.stack([np.zeros(30), np.linspace(0.0, 1.45, 30), np.zeros(30)], axis=1)
    poses: dict[str, list[Floats]] = {"Body": [], "Hat": [], "Cape": []}
    cores = []
    for share in np.sin(np.pi * np.linspace(0.0, 1.0, frames)):
        bow, tilt = np.radians(38.0) * share, np.radians(30.0) * share

        def posed(points: Floats, back: float, head: float, bow: float, tilt: float) -> Floats:
            by_head = tilt * head * smooth(points[:, 1], 1.02, 1.2)
            by_back = -bow * back * smooth(points[:, 1], 0.15, 0.75)
            points = turned(points, (0.0, 1.08, 0.0), (0.0, 0.0, 1.0), by_head)
            return turned(points, (0.0, 0.3, 0.0), (1.0, 0.0, 0.0), by_back)

        for name, points, back, head in (
            ("Body", body[0], 1.0, 1.0),
            ("Hat", hat[0], 1.0, 0.72),
            ("Cape", sheet[0], 0.82, 0.0),
        ):
            poses[name].append(posed(points, back, head, bow, tilt))
        cores.append([posed(line, 1.0, 1.0, bow, tilt)])
    faces = {"Body": body[1], "Hat": hat[1], "Cape": sheet[1]}
    meshes = {name: (np.stack(poses[name]), faces[name]) for name in faces}
    return Dressed(meshes, cores, {"Hat": [list(range(56))]})


def _heights() -> list[float]:
    parts = [(0.0, 1.0, 28), (1.02, 1.16, 6), (1.18, 1.5, 16)]
    return [float(y) for part in parts for y in np.linspace(*part)]


def _figure(y: float) -> tuple[float, float]:
    """The radius of a body with a neck and a head at a height."""
    if y <= 1.0:
        return y, 0.19 + 0.05 * np.sin(np.pi * y) - 0.13 * float(smooth(y, 0.86, 1.0))
    if y <= 1.17:
        return y, 0.075
    return y, 0.13 * float(np.sqrt(max(1.0 - ((y - 1.34) / 0.175) ** 2, 0.02)))


def _sheet(columns: int, rows: int) -> Shape:
    """An open sheet behind the shoulders, wider towards the knees."""
    down = np.linspace(0.0, 1.0, rows)[:, None]
    angle = np.pi + np.linspace(-1.9, 1.9, columns)[None]
    radius = 0.2 + 0.13 * down + 0.03 * down**2
    height = np.broadcast_to(0.93 - 0.9 * down, (rows, columns))
    points = np.stack([1.3 * radius * np.sin(angle), height, radius * np.cos(angle)], axis=2)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)[None]).ravel()
    faces = [(corner, corner + columns, corner + columns + 1), (corner, corner + columns + 1)]
    first, second = np.stack(faces[0], axis=1), np.stack([*faces[1], corner + 1], axis=1)
    return points.reshape(-1, 3), np.concatenate([first, second]).astype(np.int32)


def sleeves(frames: int = 12) -> Dressed:
    """Arms that come down by 45 degrees; their sleeves, which are tied to the shirt, by less."""
    arm = closed(
        revolved(
            [(0.0, 0.01), (0.01, 0.045)]
            + [(y, 0.048 + 0.01 * float(smooth(y, 0.3, 0.6))) for y in np.linspace(0.03, 0.6, 30)]
            + [(0.64, 0.05), (0.66, 0.01)],
            28,
        ),
        28,
    )
    cuff = revolved([(y, 0.068 + 0.004 * np.sin(9 * y)) for y in np.linspace(0.2, 0.63, 22)], 32)
    shirt = revolved(
        [(y, 0.172 - 0.02 * float(smooth(y, 1.1, 1.25))) for y in np.linspace(0.84, 1.25, 24)],
        52,
        wide=1.25,
        deep=0.88,
    )

    def hung(points: Floats, side: float, angle: float) -> Floats:
        across = (0.0, 0.0, 1.0)
        points = points - np.array([0.0, 0.66, 0.0])
        points = turned(points, (0, 0, 0), across, np.full(len(points), side * np.radians(80.0)))
        points = points + np.array([side * 0.15, 1.16, 0.0])
        down = np.full(len(points), -side * angle)
        return turned(points, (side * 0.17, 1.16, 0.0), across, down)

    poses = []
    for angle in np.radians(45.0) * np.linspace(0.0, 1.0, frames):
        arms = [hung(arm[0], side, angle) for side in (-1.0, 1.0)]
        cuffs = [hung(cuff[0], side, 0.86 * angle) for side in (-1.0, 1.0)]
        poses.append(np.concatenate([TORSO[0], *arms, shirt[0], *cuffs]))
    faces = joined([TORSO, arm, arm, shirt, cuff, cuff])
    return Dressed({"Clothed": (np.stack(poses), faces)}, [], {})
