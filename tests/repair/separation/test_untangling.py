"""Bodies that hook into each other are led apart as wholes, in clips and in single poses."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, SceneRepairer, Status
from dtrepair.numerics.geometry import FloatArray, unique_edges
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.numerics.work import add_work
from dtrepair.repair.separation.untangling import (
    UntanglingOptions,
    contact_counts,
    directions_around,
    length_along,
    shortest_direction,
    tangled_contacts,
)
from tests.exact_reference import exact_pairs
from tests.meshes import icosphere, joined

# A thin plate, and a rod that goes through it: nearly nothing of either is inside the other.
PLATE, PLATE_FACES = icosphere(3)
PLATE = PLATE * np.array([1.0, 1.0, 0.04])
ROD, ROD_FACES = icosphere(3)
ROD = ROD * np.array([0.1, 0.1, 0.8])
THROUGH = ROD + np.array([0.15, 0.1, 0.3])


def edge_change(
    before: NDArray[np.float64], after: NDArray[np.float64], faces: NDArray[np.int32]
) -> float:
    return edge_log_ratio(before, np.asarray(after, np.float64), unique_edges(faces))


@pytest.mark.parametrize("alone", [False, True])
@pytest.mark.parametrize("mobility", [0.0, 1.0])
def test_a_rod_through_a_plate_is_drawn_out_of_it(mobility: float, alone: bool) -> None:
    scene = SceneRepairer([Body(PLATE, PLATE_FACES, mobility=mobility), Body(ROD, ROD_FACES)])
    frames = [[PLATE, THROUGH + np.array([0.0, 0.0, 0.05 * k])] for k in range(1 if alone else 2)]
    if alone:
        found = [scene(pose) for pose in frames]
    else:
        found = [one.results for one in scene.animator.stream(enumerate(frames), jobs=1)]
    for poses, results in zip(frames, found, strict=True):
        after = [(results[0].points, PLATE_FACES), (results[1].points, ROD_FACES)]
        assert len(exact_pairs(*joined(*after))) == 0
        assert {result.status for result in results} == {Status.CLEAN}
        assert mobility or np.array_equal(results[0].points, PLATE)
        # Drawn out, not torn; 0.5 of it are beyond the plate at first.
        assert edge_change(poses[1], results[1].points, ROD_FACES) < 0.05
        assert np.linalg.norm(results[1].points - poses[1], axis=1).max() < 0.8


def test_what_pushing_left_as_it_was_is_tangled() -> None:
    body_of = np.array([0, 0, 1, 1, 2], dtype=np.int32)
    several = UntanglingOptions().several
    many, few = np.array([[0, 2]] * several), np.array([[3, 0]] * (several // 3))
    own = np.array([[0, 1]] * 40)
    met = contact_counts(body_of, np.concatenate([many, own]).astype(np.int32))
    assert met[0].tolist() == [[0, 1]]
    assert met[1].tolist() == [several]
    left = contact_counts(body_of, few.astype(np.int32))
    assert tangled_contacts([met], [met]) == {(0, 1)}
    assert tangled_contacts([met], [left]) == frozenset()
    # It is so in one of three frames only: pushing frees it, but for a part of the way.
    assert tangled_contacts([met] * 3, [met, left, left]) == frozenset()
    assert tangled_contacts([met] * 3, [met, left, met]) == {(0, 1)}
    # Half of a large contact is gone: pushing works.
    large = (met[0], met[1] * 3)
    assert tangled_contacts([large], [met]) == frozenset()
    assert tangled_contacts([large], [met], options=UntanglingOptions(stuck=0.3)) == {(0, 1)}


def test_the_shortest_way_is_found_and_measured() -> None:
    directions = directions_around(ROD)
    assert np.allclose(np.linalg.norm(directions, axis=1), 1.0)
    aim = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)
    found = shortest_direction(lambda shift: float(shift @ aim) > 0.5, directions, 1.0)
    assert found is not None
    assert np.allclose(found, aim)
    assert shortest_direction(lambda shift: False, directions, 1.0) is None
    length = length_along(lambda shift: float(shift @ aim) > 0.5, aim, 1.0)
    assert length is not None and 0.5 < length == pytest.approx(
        0.5, abs=1.0 / UntanglingOptions().steps
    )
    assert length_along(lambda shift: False, aim, 1.0) is None


def test_directions_of_large_bodies_are_tried_until_enough_was_done() -> None:
    directions, tried = directions_around(ROD), list[FloatArray]()

    def frees(shift: FloatArray) -> bool:
        tried.append(shift)
        add_work(1000.0)
        return False

    options = UntanglingOptions(work=10_500.0)
    assert shortest_direction(frees, directions, 1.0, options=options) is None
    assert len(tried) == 11
    assert shortest_direction(frees, directions, 1.0) is None
    assert len(tried) == 11 + UntanglingOptions().steps * len(directions)
