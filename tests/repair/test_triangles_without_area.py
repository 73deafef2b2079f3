"""Repairs of what has no area: they end, say what is left, and leave alone what touches nothing."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.diagnosis import Status
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from tests.exact_reference import check_counts
from tests.meshes import bent_tube, icosphere

BALL, FACES = icosphere(2)
NEEDLE = np.array([[0.0, 0.0, -2.0], [0.1, 0.05, 0.0], [0.2, 0.1, 2.0]])
ONE = np.array([[0, 1, 2]], dtype=np.int32)
ASIDE = np.array([3.0, 0.0, 0.0])


@pytest.mark.parametrize("method", ["full", "paper"])
def test_a_needle_is_drawn_out_of_a_ball(method: str) -> None:
    scene = SceneRepairer(
        [Body(BALL, FACES), Body(NEEDLE + ASIDE, ONE)],
        options=RepairOptions(method=method, iterations=20),
    )
    ball, needle = scene([BALL, NEEDLE])
    assert ball.before.pairs == needle.before.pairs > 0
    assert ball.after.pairs == needle.after.pairs < ball.before.pairs
    assert (ball.status is Status.CLEAN) == (ball.after.pairs == 0)
    together = np.concatenate([ball.points, needle.points])
    faces = np.concatenate([FACES, ONE + len(BALL)])
    again = SceneRepairer([Body(together, faces)])([together])[0]
    assert again.before.pairs == ball.after.pairs


def test_needles_beside_a_contact_keep_every_bit() -> None:
    tube, faces = bent_tube(6.5, 8, 24)
    rest = bent_tube(5.0, 8, 24)[0]
    away = NEEDLE - 50.0 * ASIDE
    scene = SceneRepairer([Body(rest, faces), Body(away, ONE)])
    moved, left = scene([tube, away])
    assert moved.before.pairs > 0 and moved.status is Status.CLEAN
    assert np.array_equal(left.points, away)


def test_slivers_on_the_edges_of_a_mesh_change_nothing_of_its_counts() -> None:
    tube, faces = bent_tube(6.5, 8, 24)
    rest = bent_tube(5.0, 8, 24)[0]
    chosen = faces[::7]
    middles = len(tube) + np.arange(len(chosen))
    thin = np.stack([chosen[:, 0], middles, chosen[:, 1]], axis=1)
    both = np.concatenate([faces, thin]).astype(np.int32)
    # At a corner, to the bit: amid an edge the middle would be rounded off its line.
    weld = np.concatenate([np.arange(len(tube)), chosen[:, 0]])
    plain = SceneRepairer([Body(rest, faces)])([tube])[0]
    result = SceneRepairer([Body(rest[weld], both)])([tube[weld]])[0]
    assert result.status is plain.status is Status.CLEAN
    assert result.before.pairs >= plain.before.pairs > 0
    check_counts(result, tube[weld], both)


def test_what_was_squashed_to_a_line_is_never_called_clean() -> None:
    squashed = BALL * [[1.0, 0.0, 0.0]]
    result = SceneRepairer([Body(BALL, FACES)])([squashed])[0]
    check_counts(result, squashed, FACES)
    assert result.before.pairs > 1000
    assert (result.status is Status.CLEAN) == (result.after.pairs == 0)
    if result.status is Status.UNCHANGED:
        assert np.array_equal(result.points, squashed)
