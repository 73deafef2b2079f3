"""Small loose parts go along with what they follow: glasses with a head that is pushed aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dtrepair.diagnosis import Status
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.bodies import Body
from tests.meshes import icosphere

X, Y = np.eye(3)[:2]
HEAD, POLE, EARRING = icosphere(3, 0.5), icosphere(2, 0.3), icosphere(1, 0.06)
# The pole reaches into the head by so much in each frame, which nods all the while.
DEPTHS = (0.0, 0.02, 0.05, 0.08, 0.05, 0.02, 0.0)
NODS = 0.1 * np.arange(len(DEPTHS))


def solved(
    *,
    apart: float = 0.1,
    nods: Sequence[float] = tuple(NODS),
    wall: float | None = None,
    meets: float = 0.0,
    alone: bool = False,
    options: RepairOptions | None = None,
    mobility: float = 1.0,
) -> tuple[list[list[FloatArray]], list[list[RepairResult]]]:
    """A pole that does not move goes into a rigid head; beside that hangs an earring.

    apart: how far the earring is from the head; wall: the same of something fixed, if anything,
    nearer by `meets` in the first frame; mobility: of the earring.
    """
    ring = EARRING[0] + (0.5 + 0.06 + apart) * X
    bodies = [
        Body(*HEAD, rigid=True),
        Body(*POLE, mobility=0.0),
        Body(ring, EARRING[1], mobility=mobility),
    ]
    bodies[1] = replace(bodies[1], rest=POLE[0] - 2.0 * X)
    fixed: list[FloatArray] = []
    if wall is not None:
        fixed = [EARRING[0] * [0.1, 30.0, 10.0] + (0.5 + wall) * X]
        bodies.append(Body(fixed[0], EARRING[1], mobility=0.0))
    poses: list[list[FloatArray]] = []
    for nod, depth in zip(nods, DEPTHS, strict=True):
        pole = POLE[0] + nod * Y + (depth - 0.8) * X
        walls = [own - meets * X * (len(poses) == 0) for own in fixed]
        poses.append([HEAD[0] + nod * Y, pole, ring + nod * Y, *walls])
    repairer = SceneRepairer(bodies, options=options)
    if alone:
        return poses, repairer.batch(poses)
    return poses, [own.results for own in repairer.animator.stream(enumerate(poses), jobs=1)]


def moves(
    poses: list[list[FloatArray]], found: list[list[RepairResult]], body: int
) -> list[FloatArray]:
    """How far a body moves in each frame (V, 3)."""
    return [own[body].points - pose[body] for pose, own in zip(poses, found, strict=True)]


@pytest.mark.parametrize("alone", [False, True])
def test_what_hangs_on_a_head_goes_along_and_keeps_its_shape(*, alone: bool) -> None:
    poses, found = solved(alone=alone)
    assert all(own.status is Status.CLEAN for frame in found for own in frame)
    head, ring = moves(poses, found, 0), moves(poses, found, 2)
    assert max(own[:, 0].max() for own in head) > 0.07
    for led, own in zip(head, ring, strict=True):
        assert lengths(own - own.mean(axis=0)).max() < 2e-3
        np.testing.assert_allclose(own.mean(axis=0), led.mean(axis=0), atol=3e-3)


def test_what_stands_still_or_far_away_does_not() -> None:
    far = solved(apart=0.5)
    assert not any(own.any() for own in moves(*far, 2))
    still = solved(nods=[0.0] * len(DEPTHS))
    assert max(own[:, 0].max() for own in moves(*still, 0)) > 0.07
    assert not any(own.any() for own in moves(*still, 2))


def test_what_is_held_or_limited_does_not() -> None:
    assert not any(own.any() for own in moves(*solved(mobility=0.5), 2))
    limit = RepairOptions(maximum_displacement=0.09)
    assert not any(own.any() for own in moves(*solved(options=limit), 2))


def test_it_stays_behind_where_something_is_in_the_way() -> None:
    """The wall leaves it half of the way: it takes none, and all is clean."""
    poses, found = solved(wall=0.1 + 0.12 + 0.04)
    assert all(own.status is Status.CLEAN for frame in found for own in frame)
    ring = [float(own[:, 0].max()) for own in moves(poses, found, 2)]
    assert max(ring) < 0.04
    free = [float(own[:, 0].max()) for own in moves(*solved(), 2)]
    assert max(free) > 0.07
    # It comes and goes smoothly.
    assert np.abs(np.diff(ring)).max() < 0.04


def test_what_meets_something_itself_is_solved_as_before() -> None:
    """Where the wall stands in its way in one frame only, it stays in all the others."""
    poses, found = solved(wall=0.4, meets=0.19)
    assert all(own.status is Status.CLEAN for frame in found for own in frame)
    ring = [float(np.abs(own).max()) for own in moves(poses, found, 2)]
    assert ring[0] > 5e-3
    assert ring[3] < 0.03
