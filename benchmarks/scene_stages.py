"""Stages of several objects, made in code: what `scenes.py` measures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.scene_shapes import (
    capsule,
    eased,
    lathe,
    moved,
    scaled,
    sheet,
    sword,
    times,
    turned,
)
from dtrepair.numerics.geometry import FloatArray, IntArray
from tests.meshes import icosphere, split_quads, swept, torus


@dataclass(frozen=True)
class Part:
    """One object of a stage: points (V, 3) or (T, V, 3), parents' matrices (4, 4) or (T, 4, 4).

    Matrices act on row vectors; the first parent is the outermost.
    """

    name: str
    points: FloatArray
    faces: IntArray
    parents: tuple[FloatArray, ...] = ()
    times: tuple[float, ...] = ()


@dataclass(frozen=True)
class Stage:
    """Objects, which of them are stiff, and the axis that points up."""

    parts: tuple[Part, ...]
    stiff: str = ""
    up: str = "Y"
    metres: float = 1.0


def ring_on_finger() -> Stage:
    """A ring that is too narrow slides over a knuckle, under a mirroring parent, in centimetres."""
    finger = lathe(
        [
            (0, -4),
            (0.6, -4),
            (0.95, -3.6),
            (0.85, -1),
            (1.0, 0.2),
            (0.8, 1.6),
            (0.5, 2.3),
            (0, 2.5),
        ],
        40,
    )
    slide = [moved(0.05, 0, 4.5 - 5.5 * s) for s in eased(20)]
    parents = (scaled(-1, 1.2, 1.1), np.stack([turned(x=4) @ m for m in slide]))
    return Stage(
        (
            Part("Finger", *finger, (scaled(1, 1.2, 1.1),)),
            Part("Ring", *torus(48, 16, 1.08, 0.2), parents, times(1, 20)),
        ),
        stiff="Ring",
        up="Z",
        metres=0.01,
    )


def rod_through_ball() -> Stage:
    """A rod goes into a ball and out at the other side."""
    path = [turned(y=8) @ moved(0.15, 0.08, 2.1 - 2.2 * s) for s in eased(16)]
    return Stage(
        (
            Part("Ball", *icosphere(4, 0.5), (turned(z=20),)),
            Part("Rod", *capsule(0.1, 2.4), (np.stack(path),), times(1, 16)),
        ),
        stiff="Rod",
    )


def rod_through_plate() -> Stage:
    """A rod goes through a thin plate: nearly nothing of either is ever inside the other."""
    path = [turned(x=100) @ moved(0.1, 1.1 - 1.0 * s, 0.05) for s in eased(12)]
    return Stage(
        (
            Part("Plate", *sheet(24, 24, 1.4, 1.4, 0.06), (moved(0, 0, -0.7),)),
            Part("Rod", *capsule(0.08, 1.6, 20), (np.stack(path),), times(1, 12)),
        ),
        stiff="Rod",
        up="Z",
    )


def box_in_box() -> Stage:
    """A box tumbles into an open one, through its floor and into a wall."""
    outer = lathe([(0, 0), (1, 0), (1, 1.2), (0.9, 1.2), (0.9, 0.12), (0, 0.12)], 64, power=8.0)
    inner = lathe([(0, -0.35), (0.35, -0.35), (0.35, 0.35), (0, 0.35)], 32, power=8.0)
    path = [
        turned(x=70 * s, y=20 * s) @ moved(0.3 * s, 0.42 * s, 2.0 - 1.75 * s) for s in eased(20)
    ]
    return Stage(
        (
            Part("Crate", *outer, (scaled(50, 50, 40),)),
            Part("Box", *inner, (scaled(50, 50, 50), np.stack(path)), times(1, 20)),
        ),
        stiff="Box",
        up="Z",
        metres=0.01,
    )


def cape_on_body() -> Stage:
    """A thin cape hangs behind a torso that leans back into it."""
    torso = lathe([(0, 0), (0.3, 0), (0.26, 0.4), (0.34, 0.9), (0.2, 1.15), (0, 1.2)], 48)
    points = torso[0] * [1.0, 0.7, 1.0]
    lean = 0.35 * np.sin(np.pi * np.linspace(0, 1, 20))
    frames = [
        np.stack([points[:, 0], points[:, 1] - s * points[:, 2] ** 2 / 1.2, points[:, 2]], axis=1)
        for s in lean
    ]
    cape = sheet(28, 40, 0.9, 1.15, 0.02)
    # It curves around the back, which looks along -y.
    cape_points = cape[0] + [0, -0.32, 0.02]
    cape_points[:, 1] += 0.35 * cape_points[:, 0] ** 2
    return Stage(
        (
            Part("Body", np.stack(frames), torso[1], (), times(1, 20)),
            Part("Cape", cape_points, cape[1]),
        ),
        up="Z",
    )


def belt_on_waist() -> Stage:
    """A belt around a waist that grows wider than it, in a scaled and turned nest."""
    waist = lathe([(0, -1), (0.9, -1), (0.95, -0.4), (0.7, 0), (0.85, 0.6), (0, 0.7)], 48)
    points = waist[0] * [1.0, 0.75, 1.0]
    grow = 1 + 0.12 * np.sin(np.pi * np.linspace(0, 1, 16))
    frames = np.stack([points * [g, g, 1.0] for g in grow])
    belt = lathe([(0.8, -0.12), (0.86, -0.12), (0.86, 0.12), (0.8, 0.12)], 64)
    nest = (scaled(0.5, 0.5, 0.7), turned(x=-90))
    return Stage(
        (
            Part("Body", frames, waist[1], nest, times(1, 16)),
            Part("Belt", belt[0] * [1.0, 0.75, 1.0], belt[1], nest),
        ),
    )


def two_swords_in_stone() -> Stage:
    """Two swords cross inside a stone."""
    stone, faces = icosphere(4, 1.0)
    bumps = (
        1
        + 0.08 * np.sin(5 * stone[:, 0]) * np.cos(4 * stone[:, 1] + 1)
        + 0.05 * np.sin(7 * stone[:, 2])
    )
    into = [moved(0, 0, 2.8 - 1.5 * s) for s in eased(16)]
    first = np.stack([m @ turned(y=28) for m in into])
    second = np.stack([turned(z=70) @ m @ turned(y=-32, x=6) for m in into])
    return Stage(
        (
            Part("Stone", stone * bumps[:, None] * [1.1, 1, 0.8], faces),
            Part("First", *sword(), (first,), times(1, 16)),
            Part("Second", *sword(), (second,), times(1, 16)),
        ),
        stiff="First Second",
        up="Z",
    )


def hat_on_head() -> Stage:
    """A hat that is a little small is put on a head."""
    head, faces = icosphere(4, 1.0)
    head = head * [0.8, 0.95, 1.05] + 0.05 * np.sin(3 * head[:, [1, 2, 0]])
    hat = lathe(
        [
            (0, 0.72),
            (0.6, 0.66),
            (0.8, 0.3),
            (0.8, 0),
            (1.3, -0.03),
            (1.3, 0.03),
            (0.87, 0.06),
            (0.87, 0.33),
            (0.65, 0.73),
            (0, 0.79),
        ],
        56,
    )
    hat_points = hat[0] * [0.95, 1.08, 1]
    path = [turned(x=12) @ moved(0, 0, 1.9 - 1.5 * s) for s in eased(16)]
    return Stage(
        (
            Part("Head", head, faces),
            Part("Hat", hat_points, hat[1], (np.stack(path),), times(1, 16)),
        ),
        stiff="Hat",
        up="Z",
    )


def different_ranges() -> Stage:
    """A ball that is squashed at first, a rod that comes later and has every second frame only."""
    ball, faces = icosphere(3, 0.5)
    squash = 1 + 0.25 * np.sin(np.linspace(0, 2 * np.pi, 14))
    frames = np.stack([ball * [s**-0.5, s, s**-0.5] for s in squash])
    path = np.stack([turned(z=90) @ moved(-1.6 + 1.3 * s, 0.2, 0.1) for s in eased(9)])
    return Stage(
        (
            Part("Ball", frames, faces, (scaled(2, 2, 2),), times(1, 14)),
            Part("Rod", *capsule(0.15, 1.6), (path, scaled(2, -2, 2)), times(8, 9, 2)),
        ),
    )


def linked_rings() -> Stage:
    """Two links of a chain, one pulled through the other: they stay linked."""
    link = torus(48, 16, 1.0, 0.25)
    pull = [turned(x=90) @ moved(0.7 + 0.9 * s, 0.02, 0.03) for s in eased(12)]
    return Stage((Part("First", *link), Part("Second", *link, (np.stack(pull),), times(1, 12))))


def ball_on_floor() -> Stage:
    """A ball sinks into an open floor."""
    x, y = np.meshgrid(np.linspace(-2, 2, 41), np.linspace(-2, 2, 41))
    floor = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    corner = (np.arange(40)[:, None] * 41 + np.arange(40)).ravel()
    quads = np.stack([corner, corner + 1, corner + 42, corner + 41], axis=1).astype(np.int32)
    fall = [moved(0.1, 0.05, 1.2 - 1.0 * s) for s in eased(16)]
    return Stage(
        (
            Part("Floor", floor, split_quads(quads)),
            Part("Ball", *icosphere(3, 0.5), (np.stack(fall),), times(1, 16)),
        ),
        stiff="Ball",
        up="Z",
    )


def still_life() -> Stage:
    """Three fruits in a bowl that meet each other and the bowl; no frames."""
    bowl = lathe([(0, 0), (0.6, 0.05), (1, 0.5), (0.94, 0.52), (0.56, 0.13), (0, 0.08)], 64)
    fruit, faces = icosphere(3, 0.36)
    places = [(0.3, 0, 0.36), (-0.2, 0.3, 0.38), (-0.15, -0.28, 0.36)]
    parts = [
        Part(f"Fruit{k}", fruit[:, [k, (k + 1) % 3, (k + 2) % 3]], faces, (moved(*place),))
        for k, place in enumerate(places)
    ]
    return Stage((Part("Bowl", *bowl), *parts), up="Z")


def snake_around_pole() -> Stage:
    """A snake winds around a pole that it has half sunk into."""
    t = np.linspace(0, 1, 90)
    frames = []
    for s in eased(16):
        radius = 0.5 - 0.25 * s
        angle = 2.6 * np.pi * t
        centre = np.stack([radius * np.cos(angle), radius * np.sin(angle), 2.4 * t - 1.2], axis=1)
        frames.append(swept(centre, np.full(90, 0.12), 16, closed=False))
    return Stage(
        (
            Part("Pole", *capsule(0.25, 3.4, 32)),
            Part("Snake", np.stack([p for p, _ in frames]), frames[0][1], (), times(1, 16)),
        ),
        up="Z",
    )


STAGES: dict[str, Callable[[], Stage]] = {
    make.__name__: make
    for make in (
        ring_on_finger,
        rod_through_ball,
        rod_through_plate,
        box_in_box,
        cape_on_body,
        belt_on_waist,
        two_swords_in_stone,
        hat_on_head,
        different_ranges,
        linked_rings,
        ball_on_floor,
        still_life,
        snake_around_pole,
    )
}
