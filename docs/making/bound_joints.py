"""Shapes for the bounds of what is attached: a sleeve on an arm, and an eye in a head."""

from __future__ import annotations

import numpy as np

from benchmarks.dressed_shapes import smooth
from docs.making.bound_shapes import (
    AROUND,
    CLOTH,
    DARK,
    SKIN,
    WHITE,
    Example,
    Floats,
    Mask,
    arm_along,
    arm_radius,
    middles,
    moved_most,
    painted,
)
from dtrepair.diagnosis import StrainKind
from examples.shapes import Mesh, ball, tube

# Where the sleeve ends, and where its hem comes out of the arm.
_HEM, _RING = 0.12, 0.098


def _sleeve() -> Mesh:
    """A sleeve whose elastic hem cuts into the arm."""
    x = np.linspace(-0.42, _HEM, 136)
    gap = 0.014 - 0.016 * smooth(x, 0.03, _HEM)
    points, faces = tube(np.stack([x, 0.0 * x], axis=1), arm_radius(x) + gap, AROUND)
    count = len(points) - 2
    return points[:count], faces[(faces < count).all(axis=1)]


# Finer within the sleeve than beyond it.
ARM = arm_along(np.append(np.linspace(-0.38, 0.1, 240, endpoint=False), np.linspace(0.1, 0.34, 60)))
SLEEVE = _sleeve()
_DRESSED = np.concatenate([painted(ARM, SKIN), painted(SLEEVE, CLOTH)])


def drifting_hem() -> Example:
    """A sleeve whose hem is drawn off the arm at one place."""

    def pose(harm: float) -> list[Floats]:
        x, angle = SLEEVE[0][:, 0], np.arctan2(SLEEVE[0][:, 2], SLEEVE[0][:, 1])
        near = np.exp(-((angle / 0.3) ** 2) - ((x - _HEM) / 0.025) ** 2)
        return [ARM[0], SLEEVE[0] + harm * near[:, None] * [0.0, 1.0, 0.0]]

    return Example(
        kind=StrainKind.DRIFT,
        row="drift",
        bound=".02",
        caption="drift: at most {0:.2g}, here {1:.0f} cm",
        meshes=[ARM, SLEEVE],
        paint=_DRESSED,
        pose=pose,
        within=0.039,
        beyond=0.041,
        marked=moved_most([ARM, SLEEVE]),
        look=(25.0, 15.0),
        centre=(0.13, 0.005, 0.0),
    )


def sliding_sleeve() -> Example:
    """A sleeve that slides on its arm, and bares what it covered."""

    def marked(_: list[Floats], after: list[Floats]) -> Mask:
        x = middles([ARM, SLEEVE], after)[:, 0]
        bared = (x > _RING - _HEM + after[1][:, 0].max()) & (x < _RING)
        return np.asarray(bared & (_DRESSED == SKIN))

    return Example(
        kind=StrainKind.SLIDE,
        row="slide: 95 % of all",
        bound=".004",
        caption="slide: at most {0:.2g}, here {1:.1f} cm",
        value="{1:.2f} cm",
        meshes=[ARM, SLEEVE],
        paint=_DRESSED,
        pose=lambda harm: [ARM[0], SLEEVE[0] - [harm, 0.0, 0.0]],
        within=0.0078,
        beyond=0.0082,
        marked=marked,
        look=(25.0, 15.0),
        centre=(0.13, 0.005, 0.0),
    )


def sliding_eye() -> Example:
    """An eye that comes out of a head; the hair has most of what is attached, and stays."""
    radius, eye = 0.12, ball(0.036, 30, 30)
    skull, hair = ball(radius, 70, 70), ball(0.1, 140, 140)
    nose = np.exp(-(((skull[0] - [0.0, -0.025, radius]) / [0.014, 0.025, 0.05]) ** 2).sum(axis=1))
    skull = (skull[0] + 0.03 * nose[:, None] * [0.0, 0.0, 1.0], skull[1])
    ahead = eye[0][:, [1, 2, 0]]
    sockets = np.array([[-0.046, 0.018, 0.098], [0.046, 0.018, 0.098]])
    eyes = [(ahead + socket, eye[1]) for socket in sockets]
    meshes = [skull, *eyes, (hair[0] + [0.0, 0.042, -0.042], hair[1])]
    iris = np.where(ahead[eye[1]].mean(axis=1)[:, 2] > 0.031, DARK, WHITE)
    paint = np.concatenate([painted(skull, SKIN), iris, iris, painted(hair, DARK)])

    def pose(harm: float) -> list[Floats]:
        points = [mesh[0] for mesh in meshes]
        return [points[0], points[1] + [0.0, 0.0, harm], *points[2:]]

    def marked(before: list[Floats], after: list[Floats]) -> Mask:
        was, came = (np.linalg.norm(middles(meshes, p), axis=1) for p in (before, after))
        return np.asarray((was < radius) & (came >= radius))

    return Example(
        kind=StrainKind.SLIDE,
        row="slide of one joint",
        bound=".01",
        caption="slide of one joint: at most {0:.2g}, here {1:.0f} cm",
        meshes=meshes,
        paint=paint,
        pose=pose,
        within=0.019,
        beyond=0.021,
        marked=marked,
        look=(-55.0, 5.0),
        centre=(0.0, 0.022, 0.045),
        wide=0.15,
    )
