"""A prop that is led out of something comes back in the frames around."""

from __future__ import annotations

import numpy as np

from dtrepair.diagnosis import Status
from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.surface.rigid_bodies import RigidBodies
from tests.meshes import icosphere

BLOCK, ROD = icosphere(3, 0.5), icosphere(2, 0.5)
LONG = ROD[0] * [0.2, 0.2, 1.6] + [0.0, 0.0, 0.6]
ASIDE = np.array([1.0, 0.0, 0.0])
# The rod swings into a block that does not move, in the middle frames only.
PLACES = 0.75 - 0.3 * np.exp(-0.5 * ((np.arange(21) - 10.0) / 1.5) ** 2)


def moves(*, prop: bool) -> tuple[list[FloatArray], list[FloatArray]]:
    """The rod in each frame, and where it ends."""
    rod = Body(LONG + 2.0 * ASIDE, ROD[1], rigid=not prop, prop=prop)
    repairer = SceneRepairer([Body(*BLOCK, mobility=0.0), rod])
    given = [LONG + place * ASIDE for place in PLACES]
    frames = enumerate([BLOCK[0], own] for own in given)
    found = [own.results for own in repairer.animator.stream(frames, jobs=1)]
    assert all(result.status is Status.CLEAN for frame in found for result in frame)
    return given, [frame[1].points for frame in found]


def farthest(given: list[FloatArray], ended: list[FloatArray]) -> FloatArray:
    return np.array([lengths(b - a).max() for a, b in zip(given, ended, strict=True)])


def test_a_prop_is_back_a_few_frames_from_its_contact() -> None:
    given, ended = moves(prop=True)
    far = farthest(given, ended)
    assert far.max() > 0.02
    touched = np.flatnonzero(far > 0.5 * far.max())
    assert far[: touched[0] - 5].max(initial=0.0) == far[touched[-1] + 6 :].max(initial=0.0) == 0.0
    # What is only called rigid keeps its slow way, as before.
    slow = farthest(*moves(prop=False))
    assert np.count_nonzero(slow) > np.count_nonzero(far)


def test_it_keeps_its_shape_and_comes_and_goes_smoothly() -> None:
    given, ended = moves(prop=True)
    whole = RigidBodies([(0, len(LONG))], np.ones(len(LONG)))
    for before, after in zip(given, ended, strict=True):
        assert lengths(whole.fitted(before, after) - after).max() < 1e-6
    far = farthest(given, ended)
    assert np.abs(np.diff(far)).max() < 0.5 * far.max()
