"""What was found for the same poses is not found again."""

from __future__ import annotations

import pickle

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.recent import Recent


def length(*poses: FloatArray) -> float:
    return float(sum(np.linalg.norm(pose) for pose in poses))


def test_a_function_is_asked_once_for_the_same_poses() -> None:
    asked: list[int] = []

    def counted(*poses: FloatArray) -> float:
        asked.append(len(poses))
        return length(*poses)

    recent = Recent[float]()
    first, second = np.ones((4, 3)), np.zeros((4, 3))
    for _ in range(2):
        assert recent(counted, first.copy(), second.copy()) == length(first, second)
    assert asked == [2]
    # Only what was found last is kept, and of all poses.
    for poses in ((second, second), (second, first), (second,), (second, first)):
        assert recent(counted, *poses) == length(*poses)
    assert asked == [2, 2, 2, 1, 2]


def test_a_pose_that_was_changed_in_place_is_another_one() -> None:
    recent, pose = Recent[float](), np.ones((4, 3))
    before = recent(length, pose)
    pose *= 2.0
    assert recent(length, pose) == 2.0 * before


def test_what_is_known_does_not_travel() -> None:
    recent, pose = Recent[float](), np.ones((4, 3))
    assert recent(length, pose) == 12.0**0.5
    again = pickle.loads(pickle.dumps(recent))
    assert again._known is None and again(length, pose) == recent(length, pose)
