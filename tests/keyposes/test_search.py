"""Poses between keys: interpolation as USD has it, keys moved or added, honest about the rest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from pxr import Usd, UsdGeom, Vt

from dtrepair import Repairer, RepairOptions, find_intersections
from dtrepair.keyposes.changes import ChangeOptions, neighbours_moved, scaled
from dtrepair.keyposes.options import KeyOptions
from dtrepair.keyposes.search import clean_in_betweens, verify_in_betweens
from dtrepair.keyposes.search_options import SearchOptions
from dtrepair.keyposes.spans import Sample
from dtrepair.keyposes.tracks import Pose, Track, between
from tests.swinging_arm import arm_mesh, arm_pose


def float32(points: ArrayLike) -> NDArray[np.float32]:
    return np.asarray(points, dtype=np.float32)


def random_poses(count: int = 3, vertices: int = 500) -> list[NDArray[np.float32]]:
    generator = np.random.default_rng(7)
    return [float32(10 * generator.standard_normal((vertices, 3))) for _ in range(count)]


def test_linear_in_betweens_are_those_of_usd_bit_for_bit() -> None:
    times, poses = (1.0, 8.5, 9.25), random_poses()
    stage = Usd.Stage.CreateInMemory()
    points = UsdGeom.Mesh.Define(stage, "/Mesh").CreatePointsAttr()
    for time, pose in zip(times, poses, strict=True):
        points.Set(Vt.Vec3fArray.FromNumpy(pose), time)
    for time in (0.0, 1.0, 1.1, 2 + 1 / 3, 8.4999, 8.5, 8.7, 9.25, 11.0):
        assert np.array_equal(between(times, poses, time), np.array(points.Get(time))), time
    del points, stage


def test_cubic_in_betweens_follow_a_parabola_where_linear_ones_do_not() -> None:
    # Central differences are exact for a parabola over even keys, in the spans between inner ones.
    times = (0.0, 1.0, 2.0, 3.0)
    poses = [float32([[t, t * t, 1.0]]) for t in times]
    found = between(times, poses, 1.3, interpolation="cubic")
    assert found == pytest.approx(np.array([[1.3, 1.69, 1.0]]), abs=1e-6)
    assert between(times, poses, 1.3)[0, 1] == pytest.approx(1.9, abs=1e-6)
    for time, pose in zip(times, poses, strict=True):
        assert np.array_equal(between(times, poses, time, interpolation="cubic"), pose)
    with pytest.raises(ValueError, match="one of linear, cubic, got 'held'"):
        between(times, poses, 1.3, interpolation="held")


def test_tracks_refuse_keys_that_do_not_fit() -> None:
    pose = np.zeros((1, 3), np.float32)
    with pytest.raises(ValueError, match="each of 2 times"):
        Track((1.0, 2.0), (pose,))
    with pytest.raises(ValueError, match="times should increase"):
        Track((1.0, 1.0), (pose, pose))


def test_tracks_take_keys_and_give_them_back() -> None:
    first, second, other = random_poses()
    track = Track((1.0, 3.0), (first, second))
    more = track.with_key(2.0, other)
    assert more.times == (1.0, 2.0, 3.0) and more.changed == {2.0}
    assert np.array_equal(more.at(2.0), other) and track.times == (1.0, 3.0)
    assert more.without_key(2.0).times == (1.0, 3.0) and not more.without_key(2.0).changed
    assert more.without_key(9.0) is more
    assert track.around(2.5) == (1.0, 3.0)
    assert track.around(1.0) is None and track.around(3.5) is None
    assert more.reach(2.0) == (1.0, 3.0) and more.reach(1.0) == (-np.inf, 2.0)
    assert more.reach(1.0, interpolation="cubic") == (-np.inf, 3.0)


def test_a_still_mesh_changes_at_the_new_key_only() -> None:
    pose, other = random_poses(2)
    track = Track((), (pose,)).with_key(2.0, other, all_times=(1.0, 2.0, 3.0))
    assert track.times == (1.0, 2.0, 3.0)
    assert np.array_equal(track.at(1.0), pose) and np.array_equal(track.at(3.0), pose)


def test_the_original_holds_until_a_key_changes() -> None:
    first, second, other = random_poses()
    track = Track((1.0, 3.0), (first, second), original=lambda time: other)
    assert np.array_equal(track.at(2.0), other)
    changed = track.with_key(1.0, first + 1)
    assert np.array_equal(changed.at(2.0), between((1.0, 3.0), (first + 1, second), 2.0))


def test_frames_between_keys_are_displaced_as_the_keys_around_them() -> None:
    start, *given = random_poses(3, 20)

    def bent(time: float) -> NDArray[np.float32]:
        return float32(start + time**2 * given[0])

    keys = (0.0, 4.0, 8.0)
    frames = (1.0, 2.0, 3.0, 5.0, 6.0, 7.0)
    track = Track(keys, tuple(bent(key) for key in keys), original=bent, frames=frames)
    assert np.array_equal(track.at(2.5), bent(2.5))
    moved = track.with_key(4.0, bent(4.0) + given[1])
    assert moved.written == tuple(range(9))
    assert [moved.moved_at(time) for time in moved.written] == [False] + [True] * 7 + [False]
    for time, share in ((1.0, 0.25), (2.0, 0.5), (4.0, 1.0), (7.0, 0.25)):
        assert moved.at(time) == pytest.approx(bent(time) + share * given[1], rel=1e-4, abs=1e-4)
    for way in ("linear", "cubic"):
        samples = [moved.at(time) for time in moved.written]
        expected = between(moved.written, samples, 4.4, interpolation=way)
        assert np.array_equal(moved.at(4.4, interpolation=way), expected)
    assert np.array_equal(moved.with_key(8.0, bent(8.0)).at(1.0), moved.at(1.0))


def test_frames_between_keys_are_looked_at() -> None:
    pose = random_poses(1)[0]
    track = Track((0.0, 4.0), (pose, pose), original=lambda time: pose, frames=(1.0, 2.0, 3.0))

    class Dirty:
        ways = (0,)

        def pairs(self, time: float, poses: Sequence[Pose]) -> int:
            return int(time == 3.0)

        def repair(self, time: float, poses: Sequence[Pose], way: int) -> None:
            return None

        def allowed(self, index: int, time: float, given: Pose, pose: Pose) -> Pose:
            return pose

    found = verify_in_betweens([track], [(0.0, 4.0)], Dirty(), options=KeyOptions(samples=1))
    assert found.spans[0].before == (Sample(1.0, 0), Sample(2.0, 0), Sample(3.0, 1))


@pytest.mark.parametrize("only_added", [False, True])
def test_neighbours_are_moved_such_that_the_in_between_is_met(only_added: bool) -> None:
    first, second = random_poses(2)
    track = Track((0.0, 10.0), (first, second))
    pose = track.at(2.5)
    aim = pose.copy()
    aim[3] += 0.2
    change = neighbours_moved([track], 2.5, [pose], [aim], (0.0,), only_added=only_added)
    assert change is not None and not change.added
    for _, time, key in change.keys:
        track = track.with_key(time, key)
    assert track.changed == ({0.0} if only_added else {0.0, 10.0})
    assert track.at(2.5) == pytest.approx(aim, abs=1e-5)
    assert np.array_equal(track.poses[0][4:], first[4:])  # what did not move keeps every bit


def test_given_keys_are_not_moved_far() -> None:
    track = Track((0.0, 10.0), tuple(random_poses(2)))
    pose = track.at(5.0)
    diagonal = float(np.linalg.norm(np.ptp(pose, axis=0)))
    for part, moves in ((0.9, True), (1.1, False)):
        aim = pose + float32([part * ChangeOptions.farthest * diagonal, 0, 0])
        assert (neighbours_moved([track], 5.0, [pose], [aim]) is not None) == moves
    assert neighbours_moved([track], 10.0, [pose], [pose + 1]) is None


def test_scaled_displacements_keep_unmoved_bits() -> None:
    old, _ = random_poses(2)
    new = old.copy()
    new[0] += 1
    farther = scaled(old, new, 1.5)
    assert farther[0] == pytest.approx(old[0] + 1.5) and np.array_equal(farther[1:], old[1:])


class ArmSolver:
    """Counts and repairs the arm; `cases` are repairs asked for."""

    ways = (0,)

    def __init__(self, *, helpless: bool = False) -> None:
        _, self.faces = arm_mesh(1.0)
        self.repairer = (
            None
            if helpless
            else Repairer(arm_pose(1.0), self.faces, options=RepairOptions(tighten=0))
        )
        self.cases = 0

    def pairs(self, time: float, poses: Sequence[NDArray[np.float32]]) -> int:
        return len(find_intersections(poses[0], self.faces))

    def repair(
        self, time: float, poses: Sequence[NDArray[np.float32]], way: int
    ) -> tuple[NDArray[np.float32], ...] | None:
        self.cases += 1
        if self.repairer is None:
            return None
        result = self.repairer(poses[0])
        return (result.points,) if result.after.pairs < result.before.pairs else None

    def allowed(
        self, index: int, time: float, given: NDArray[np.float32], pose: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        return pose


def arm_track(*swings: float) -> Track:
    times = tuple(10.0 * k for k in range(len(swings)))
    return Track(times, tuple(float32(arm_pose(swing)) for swing in swings))


def dirty(samples: Iterable[Sample]) -> list[float]:
    return [sample.time for sample in samples if sample.pairs]


def test_in_betweens_of_a_swing_through_the_body_become_clean() -> None:
    track, solver = arm_track(1.0, -1.0, -0.8), ArmSolver()
    spans = [(0.0, 10.0), (10.0, 20.0)]
    options = KeyOptions(samples=5, keep_keys=True)
    found = clean_in_betweens([track], spans, solver, options=options)
    swing, rest = found.spans
    assert dirty(swing.before) and not dirty(swing.after) and 1 <= len(swing.added) <= 3
    assert not dirty(rest.before) and not rest.added
    result = found.tracks[0]
    assert result.changed == set(swing.added)  # given keys stay
    assert len(swing.after) == 5 * (1 + len(swing.added))
    for sample in swing.after:
        assert solver.pairs(sample.time, [result.at(sample.time)]) == sample.pairs == 0
    again = verify_in_betweens([result], [(0.0, 10.0)], solver, options=options)
    assert again.tracks == (result,)


def test_verification_changes_nothing() -> None:
    track, solver = arm_track(1.0, -1.0), ArmSolver()
    found = verify_in_betweens([track], [(0.0, 10.0)], solver, options=KeyOptions(), jobs=2)
    assert found.tracks == (track,) and solver.cases == 0
    (span,) = found.spans
    assert span.before == span.after and [s.time for s in span.after] == [2.0, 4.0, 6.0, 8.0]
    assert [s.pairs for s in span.after] == [
        solver.pairs(t, [track.at(t)]) for t in (2.0, 4.0, 6.0, 8.0)
    ]


class SteepSolver:
    """Wants one vertex beyond a curve that no chain of lines from the first key stays beyond."""

    ways = (0,)

    def pairs(self, time: float, poses: Sequence[NDArray[np.float32]]) -> int:
        return int(poses[0][0, 0] < np.sqrt(time) - 1e-6)

    def repair(
        self, time: float, poses: Sequence[NDArray[np.float32]], way: int
    ) -> tuple[NDArray[np.float32], ...]:
        return (float32([[1.1 * np.sqrt(time), 0.0, 0.0]]),)

    def allowed(
        self, index: int, time: float, given: NDArray[np.float32], pose: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        return float32(np.minimum(pose, 1.15 * np.sqrt(time)))


@pytest.mark.parametrize("shortest", [0.1, 1e-9])
def test_keys_do_not_crowd_where_none_helps(shortest: float) -> None:
    track = Track((0.0, 10.0), tuple(float32([[x, 0.0, 0.0]]) for x in (0.0, 4.0)))
    options, numbers = KeyOptions(keep_keys=True), SearchOptions(shortest=shortest)
    found = clean_in_betweens(
        [track], [(0.0, 10.0)], SteepSolver(), options=options, numbers=numbers
    )
    (span,) = found.spans
    assert dirty(span.after)[0] < 1.0 and span.added
    nearest = float(np.diff([0.0, *sorted(span.added), 10.0]).min())
    assert (nearest >= shortest * 10.0 / (options.samples + 1)) and (nearest < 0.1) == (
        shortest < 0.1
    )


@pytest.mark.parametrize("helpless", [True, False])
def test_what_cannot_be_cleaned_is_told(helpless: bool) -> None:
    # No solver, or no keys to add: the samples say what is left, and the keys stay.
    track = arm_track(1.0, -1.0)
    options = KeyOptions(extra=8 if helpless else 0)
    found = clean_in_betweens([track], [(0.0, 10.0)], ArmSolver(helpless=helpless), options=options)
    (span,) = found.spans
    assert dirty(span.after) == dirty(span.before) == [4.0, 6.0] and not span.added
    assert found.tracks == (track,)


def test_bad_options_are_refused() -> None:
    for name in ("samples", "extra"):
        with pytest.raises(ValueError, match=f"{name} should be at least"):
            KeyOptions(**{name: -1})  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="linear, cubic"):
        KeyOptions(interpolation="held")


class Ended(Exception):
    """What a check raises."""


@pytest.mark.parametrize("asked", [1, 3, 8])
def test_a_check_ends_a_search(asked: int) -> None:
    track, solver = arm_track(1.0, -1.0, -0.8), ArmSolver()
    asked_so_far = 0

    def check() -> None:
        nonlocal asked_so_far
        asked_so_far += 1
        if asked_so_far == asked:
            raise Ended

    spans = [(0.0, 10.0), (10.0, 20.0)]
    with pytest.raises(Ended):
        clean_in_betweens([track], spans, solver, options=KeyOptions(), jobs=2, check=check)
    assert asked_so_far == asked
