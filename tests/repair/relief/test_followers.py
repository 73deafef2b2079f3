"""Small loose parts go along with what they follow: glasses with a head that is pushed aside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dtrepair.diagnosis import Status
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.result import RepairResult
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from tests.meshes import Mesh, icosphere, joined

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
    ring: Mesh = EARRING,
    rigid: bool = False,
    origin: float = 0.0,
    modelled: bool = False,
) -> tuple[list[list[FloatArray]], list[list[RepairResult]]]:
    """A pole that does not move goes into a rigid head; beside that hangs an earring.

    apart: how far the earring is from the head; wall: the same of something fixed, if anything,
    nearer by `meets` in the first frame; mobility, ring, rigid: of the earring;
    origin: added to all places of the poses and rests; modelled: what meets at rest was meant.
    """
    hung = ring[0] + (0.5 + 0.06 + apart) * X
    bodies = [
        Body(*HEAD, rigid=True),
        Body(*POLE, mobility=0.0),
        Body(hung, ring[1], mobility=mobility, rigid=rigid),
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
        own = [HEAD[0] + nod * Y, pole, hung + nod * Y, *walls]
        poses.append([points + origin for points in own])
    bodies = [replace(body, rest=np.asarray(body.rest) + origin) for body in bodies]
    rests = [(np.asarray(body.rest), np.asarray(body.faces)) for body in bodies]
    points, faces = joined(*rests)
    shown = [Reference(points, Detector(points, faces)(points))] if modelled else []
    repairer = SceneRepairer(bodies, options=options, references=shown)
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


def test_a_pair_follows_as_one_where_it_is_rigid() -> None:
    pair = joined((EARRING[0] + 0.1 * Y, EARRING[1]), (EARRING[0] - 0.1 * Y, EARRING[1]))
    poses, found = solved(ring=pair, rigid=True)
    for pose, own, led in zip(poses, found, moves(poses, found, 0), strict=True):
        shape = RigidBodies([(0, len(pair[0]))], np.ones(len(pair[0])))
        ended = own[2].points
        assert lengths(shape.fitted(pose[2], ended) - ended).max() < 1e-6
        np.testing.assert_allclose((ended - pose[2]).mean(axis=0), led.mean(axis=0), atol=3e-3)


def test_what_holds_on_to_each_other_follows_as_one() -> None:
    """A lens in its frame: the two overlap at rest."""
    pair = joined((EARRING[0] + 0.04 * Y, EARRING[1]), (EARRING[0] - 0.04 * Y, EARRING[1]))
    poses, found = solved(ring=pair, modelled=True)
    for pose, own, led in zip(poses, found, moves(poses, found, 0), strict=True):
        ended = own[2].points
        assert lengths(ended - pose[2] - (ended - pose[2]).mean(axis=0)).max() < 3e-3
        np.testing.assert_allclose((ended - pose[2]).mean(axis=0), led.mean(axis=0), atol=3e-3)


def test_what_is_split_at_its_seams_stays_whole() -> None:
    split = EARRING[0][EARRING[1]].reshape(-1, 3), np.arange(EARRING[1].size).reshape(-1, 3)
    poses, found = solved(ring=(split[0], split[1].astype(np.int32)), alone=True)
    assert all(own.status is Status.CLEAN for frame in found for own in frame)
    assert max(own[:, 0].max() for own in moves(poses, found, 2)) > 0.07
    whole = EARRING[1].ravel()
    for frame in found:
        points = frame[2].points
        for corner in range(len(EARRING[0])):
            assert np.ptp(points[whole == corner], axis=0).max() < 1e-6


def test_what_stands_still_does_not_far_from_the_origin_either() -> None:
    still = solved(nods=[0.0] * len(DEPTHS), origin=1000.0)
    assert max(own[:, 0].max() for own in moves(*still, 0)) > 0.07
    assert not any(own.any() for own in moves(*still, 2))


def test_what_stands_still_or_far_away_does_not() -> None:
    far = solved(apart=0.5)
    assert not any(own.any() for own in moves(*far, 2))
    still = solved(nods=[0.0] * len(DEPTHS))
    assert max(own[:, 0].max() for own in moves(*still, 0)) > 0.07
    assert not any(own.any() for own in moves(*still, 2))


def test_what_is_held_or_limited_does_not() -> None:
    assert not any(own.any() for own in moves(*solved(mobility=0.5), 2))
    limited = solved(options=RepairOptions(maximum_displacement=0.09))
    assert not any(own.any() for own in moves(*limited, 2))
    # Contacts are opened when all has followed.
    apart = solved(options=RepairOptions(clearance=0.001))
    assert any(own.any() for own in moves(*apart, 2))


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
