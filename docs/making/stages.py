"""The stages that the pictures of the documentation are made of: all meshes are made in code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from benchmarks import dressed as dressed_stages
from benchmarks.dressed_shapes import TORSO, closed, joined, revolved, turned
from dtrepair.demo.character import make_character
from examples import dressed_character
from examples.shapes import Mesh, arm, ball, tube
from usd_io import AuthoredMesh, write_animation

Floats = NDArray[np.float64]
Point = tuple[float, float, float]
# Degrees by which the avatar's right arm turns: inwards at the elbow, down and forwards.
BENT = (45.0, 26.0, 20.0)


def still(path: Path, meshes: dict[str, Mesh]) -> Path:
    """Write meshes by name, at time 1."""
    made = [
        AuthoredMesh(f"/Scene/{name}", faces, points=[points])
        for name, (points, faces) in meshes.items()
    ]
    write_animation(path, made, times=[1.0])
    return path


def lifted(path: Path, meshes: dict[str, Mesh], poses: dict[str, Floats] | None = None) -> Path:
    """Write meshes by name: the bind pose at the default time, bent upwards at time 1.

    poses: points to bend of meshes that are somewhere else than in the bind pose.
    """
    made = []
    for name, (points, faces) in meshes.items():
        pose = (poses or {}).get(name, points)
        bent = pose + np.stack([0 * pose[:, 0], 0.06 * pose[:, 0] ** 2, 0 * pose[:, 0]], axis=1)
        made.append(AuthoredMesh(f"/Scene/{name}", faces, points=[points, bent], rest=points))
    write_animation(path, made, times=[0.0, 1.0])
    return path


def along(line: Floats, radius: float) -> Mesh:
    """A tube along a line (N, 2) of the x-y plane."""
    return tube(line, radius, 20)


def straight(start: tuple[float, float], end: tuple[float, float], rows: int = 60) -> Floats:
    """Points (rows, 2) of a line."""
    return np.linspace(start, end, rows)


def arm_and_ball(folder: Path) -> Path:
    """ball.usda: a ball deep in the middle of an arm; the primvar `ends` fades from 1 to 0."""
    points, faces = arm(0.0, rows=80, around=20)
    centred, round_faces = ball(0.3)
    meshes = {
        "Arm": (points, faces),
        "Ball": (centred + np.array([1.0, 0.28, 0.0]), round_faces),
    }
    path = still(folder / "ball.usda", meshes)
    stage = Usd.Stage.Open(str(path))
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/Scene/Arm")).CreatePrimvar(
        "ends", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex
    )
    far = np.clip((np.abs(points[:, 0] - 1.0) - 0.3) / 0.6, 0.0, 1.0)
    primvar.Set((far * far * (3.0 - 2.0 * far)).tolist())
    stage.Save()
    return path


def sword(folder: Path) -> Path:
    """sword.usda: a thin straight bar that lies in the surface of a thick arm."""
    meshes = {
        "Arm": along(straight((0.0, 0.0), (1.6, 0.0), 80), 0.16),
        "Sword": along(straight((0.4, 0.15), (2.0, 0.23), 80), 0.03),
    }
    return still(folder / "sword.usda", meshes)


def knob(folder: Path) -> Path:
    """knob.usda: a stick that ends in a ball, as modelled, and a finger that comes into it."""
    head = ball(0.24)
    finger = along(straight((0.5, 0.28), (0.5, 0.9), 40), 0.08)
    meshes = {
        "Stick": along(straight((0.0, 0.0), (1.4, 0.0)), 0.09),
        "Knob": (head[0] + np.array([1.48, 0.0, 0.0]), head[1]),
        "Finger": finger,
    }
    return lifted(folder / "knob.usda", meshes, {"Finger": finger[0] - np.array([0.0, 0.3, 0.0])})


def mistake(folder: Path) -> Path:
    """mistake.usda: a finger lies in an arm in the bind pose already; apart.usda: it does not."""
    finger = along(straight((0.4, 0.06), (1.0, 0.5), 40), 0.08)
    meshes = {"Arm": along(straight((0.0, 0.0), (1.4, 0.0)), 0.12), "Finger": finger}
    apart = {**meshes, "Finger": (finger[0] + np.array([0.0, 0.3, 0.0]), finger[1])}
    still(folder / "apart.usda", apart)
    return lifted(folder / "mistake.usda", meshes)


def dressed(folder: Path) -> Path:
    """dressed.usda: the example of a dressed character."""
    dressed_character.main(folder / "dressed.usda")
    return folder / "dressed.usda"


def sleeves(folder: Path) -> Path:
    """sleeves.usdc: body, arms, shirt and sleeves as six parts of one mesh; the arms come down."""
    return dressed_stages.write("sleeves", folder)


def skirt(folder: Path) -> Path:
    """skirt.usdc: an open skirt over two legs that swing through it."""
    return dressed_stages.write("skirt", folder)


def cape(folder: Path) -> Path:
    """cape.usdc: a hat and an open cape on a body that bows."""
    return dressed_stages.write("cape", folder)


def hugging(folder: Path) -> Path:
    """hugging.usda: the deepest pose of the character of the demo."""
    body = make_character(3)
    mesh = AuthoredMesh("/Character/Body", body.quads, points=[body.points[1]], rest=body.rest)
    write_animation(folder / "hugging.usda", mesh, times=[1.0])
    return folder / "hugging.usda"


def avatar(folder: Path) -> Path:
    """avatar.usda: a body of ten parts that overlap at their joints, in a tunic; an arm swings.

    The bind pose is at the default time; at time 1 the right forearm has come through the tunic.
    """
    bind, posed = _avatar(0.0), _avatar(1.0)
    meshes = [
        AuthoredMesh(f"/Hero/{name}", faces, points=[points], rest=bind[name][0])
        for name, (points, faces) in posed.items()
    ]
    write_animation(folder / "avatar.usda", meshes, times=[1.0])
    return folder / "avatar.usda"


def _avatar(swing: float) -> dict[str, Mesh]:
    """The body of an avatar and its tunic; from 0, the bind pose, to 1."""
    upper, lower = _limb(0.3, 0.055, 0.048), _limb(0.34, 0.046, 0.04)
    thigh, shin = _limb(0.42, 0.085, 0.068), _limb(0.46, 0.062, 0.05)
    head = [(1.27, 0.01), (1.28, 0.05), (1.32, 0.055), (1.38, 0.055)]
    for angle in np.linspace(0.25 * np.pi, 0.97 * np.pi, 14):
        head.append((1.5 - 0.12 * float(np.cos(angle)), 0.1 * float(np.sin(angle))))
    parts = [TORSO, closed(revolved(head, 24), 24)]
    for side in (-1.0, 1.0):
        # In the bind pose the arms hang out to their sides; the left one turns less than the right.
        share = swing if side < 0.0 else 0.4 * swing
        bend, down, ahead = (share * np.radians(angle) for angle in BENT)
        out = np.radians(50.0) - down
        for (points, faces), top in ((upper, 0.0), (lower, -0.27)):
            arm = points + np.array([0.0, top, 0.0])
            if top:
                arm = _turned(arm, (0.0, top, 0.0), (0, 0, 1), -side * bend)
            arm = _turned(arm, (0.0, 0.0, 0.0), (0, 0, 1), side * out)
            arm = _turned(arm, (0.0, 0.0, 0.0), (1, 0, 0), -ahead)
            parts.append((arm + np.array([0.17 * side, 1.2, 0.0]), faces))
        for (points, faces), top in ((thigh, 0.86), (shin, 0.46)):
            parts.append((points + np.array([0.1 * side, top, 0.0]), faces))
    tunic, faces = revolved(
        [(y, 0.172 + 0.1 * (1.26 - y) ** 2) for y in np.linspace(0.62, 1.26, 24)],
        40,
        wide=1.25,
        deep=0.95,
    )
    tunic = tunic + 0.01 * swing * (1.26 - tunic[:, 1:2]) * np.array([0, 0, 1])  # sways a little
    return {"Body": (np.concatenate([p for p, _ in parts]), joined(parts)), "Tunic": (tunic, faces)}


def _turned(points: Floats, pivot: Point, axis: Point, angle: float) -> Floats:
    return turned(points, pivot, axis, np.full(len(points), angle))


def _limb(length: float, start: float, end: float) -> Mesh:
    """A closed limb that hangs down from a little above the origin."""
    tips = [(-length - 0.6 * end, 0.3 * end), (-length - 0.35 * end, 0.75 * end)]
    tops = [(0.04 + 0.35 * start, 0.75 * start), (0.04 + 0.6 * start, 0.3 * start)]
    rows = np.linspace((-length, end), (0.04, start), 15)
    sides = [(float(y), float(radius)) for y, radius in rows]
    return closed(revolved([*tips, *sides, *tops], 16), 16)
