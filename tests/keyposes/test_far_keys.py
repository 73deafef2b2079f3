"""Keys do not go far out, and others are added instead."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.keyposes.changes import Change, moved_farther, usual_move
from dtrepair.keyposes.options import KeyOptions
from dtrepair.keyposes.search import clean_in_betweens
from dtrepair.keyposes.search_options import SearchOptions
from dtrepair.keyposes.spans import KeyPoses
from dtrepair.keyposes.tracks import Track

Pose = NDArray[np.float32]
# A pose ten long whose first vertex has to stay beyond walls.
STILL = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 10.0]], dtype=np.float32)


class WallSolver:
    """Wants the first vertex beyond walls: at times from, to, each as high as the third number."""

    def __init__(
        self, *walls: tuple[float, float, float], beyond: Sequence[float] = (0.05,)
    ) -> None:
        self.walls, self.beyond, self.ways = walls, beyond, range(len(beyond))

    def wanted(self, time: float) -> float:
        return max((high for start, end, high in self.walls if start < time < end), default=-9.0)

    def pairs(self, time: float, poses: Sequence[Pose]) -> int:
        return int(poses[0][0, 0] < self.wanted(time))

    def repair(self, time: float, poses: Sequence[Pose], way: int) -> tuple[Pose, ...]:
        found = poses[0].copy()
        found[0, 0] = max(found[0, 0], self.wanted(time) + self.beyond[way])
        return (found,)

    def allowed(self, index: int, time: float, given: Pose, pose: Pose) -> Pose:
        return pose


def cleaned(solver: WallSolver, *, extra: int = 8, **numbers: float) -> KeyPoses:
    track, options = Track((0.0, 10.0), (STILL, STILL)), KeyOptions(keep_keys=True, extra=extra)
    search = SearchOptions(**numbers)  # type: ignore[arg-type]
    return clean_in_betweens([track], [(0.0, 10.0)], solver, options=options, numbers=search)


def left(found: KeyPoses) -> int:
    return sum(sample.pairs for sample in found.spans[0].after)


def highest(found: KeyPoses) -> float:
    return max(float(pose[0, 0]) for pose in found.tracks[0].poses)


@pytest.mark.parametrize(("farther", "most"), [(1.5, 3.0), (np.inf, np.inf)])
def test_keys_are_added_before_one_flies_out(farther: float, most: float) -> None:
    found = cleaned(WallSolver((1.5, 9.5, 1.0)), farther=farther)
    assert left(found) == 0
    assert highest(found) < most and (farther == 1.5 or highest(found) > 5.0)


def test_what_would_be_clean_with_a_far_key_only_is_left() -> None:
    wall = WallSolver((1.5, 9.5, 1.0))
    found = cleaned(wall, extra=1)
    assert left(found) > 0 and highest(found) < 3.0
    assert left(cleaned(wall, extra=1, farther=1e9)) == 0


def test_the_nearest_that_is_clean_is_added() -> None:
    wall = (1.5, 9.5, 1.0)
    for farther in ([0.05, 0.3], [0.05, 0.3, 9.0]):
        found = cleaned(WallSolver(wall, beyond=farther))
        assert left(found) == 0 and highest(found) == highest(cleaned(WallSolver(wall)))


def test_farther_ways_are_tried_within_the_limit_of_the_nearest_and_then_their_own() -> None:
    """With one key to add at most, from which the lines fall below the wall."""
    narrow = WallSolver((4.0, 6.0, 1.0), beyond=[0.05, 0.6, 9.0])
    assert left(cleaned(narrow, extra=1)) == 0 and highest(cleaned(narrow, extra=1)) < 1.8
    wide = (1.5, 9.5, 1.0)
    assert left(cleaned(WallSolver(wide), extra=1)) > 0
    far = cleaned(WallSolver(wide, beyond=[0.05, 9.0]), extra=1)
    assert left(far) == 0 and 5.0 < highest(far) < 16.0


def test_short_parts_are_no_way_to_fly_out() -> None:
    wall = WallSolver((0.2, 9.9, 1.0))
    assert highest(cleaned(wall, shortest=0.2)) < 2.0
    assert highest(cleaned(wall, shortest=0.2, farther=1e9)) > 5.0


def test_moves_are_measured_from_what_was_given_in_diagonals() -> None:
    large = 10.0 * STILL
    given = [Track((0.0, 10.0), (pose, pose)) for pose in (STILL, large)]
    tracks = [own.with_key(0.0, own.poses[0] + np.full(3, 2.0, np.float32)) for own in given]
    step = np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]], dtype=np.float32)
    far = [pose + step for pose in (STILL, large)]
    usual = partial(usual_move, tracks, given, "linear", (0.0, 10.0))
    shift = 2.0 * np.sqrt(3.0)
    assert usual([], 5.0, None) == pytest.approx(shift / 10.0)
    assert usual([], 5.0, far) == pytest.approx(shift / 10.0)
    assert usual([0.0], 5.0, far) == pytest.approx(3.0 / 10.0)
    assert usual([0.0], 5.0, None) == 0.0
    moved = partial(moved_farther, tracks, given, "linear")
    assert moved(Change([(0, 5.0, far[0]), (1, 5.0, far[1])], (5.0,))) == pytest.approx(0.3)
    assert moved(Change([(1, 5.0, far[1])], (5.0,))) == pytest.approx(0.03)
    # A key that goes back has not gone far.
    assert moved(Change([(0, 0.0, far[0])], ())) == 0.0


def test_what_is_clean_with_far_keys_is_so_without_nearly_always() -> None:
    random, nearer, lost = np.random.default_rng(0), 0, 0
    for _ in range(60):
        ends = np.sort(random.uniform(0.3, 9.7, 4))
        highs = random.uniform(0.3, 1.5, 2)
        both = zip(list(pairwise(ends))[::2], highs, strict=True)
        solver = WallSolver(*((start, end, high) for (start, end), high in both))
        far, near = cleaned(solver, farther=1e9), cleaned(solver)
        lost += left(near) > left(far)
        nearer += highest(near) < highest(far)
    assert nearer > 5 and lost <= 3
