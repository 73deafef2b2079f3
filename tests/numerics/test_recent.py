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

    recent = Recent(counted)
    first, second = np.ones((4, 3)), np.zeros((4, 3))
    assert recent(first, second) == recent(first.copy(), second) == length(first, second)
    assert asked == [2]
    # Only what was found last is kept.
    assert recent(second, first) == recent(first, second) and len(asked) == 3


def test_a_pose_that_was_changed_in_place_is_another_one() -> None:
    recent, pose = Recent(length), np.ones((4, 3))
    before = recent(pose)
    pose *= 2.0
    assert recent(pose) == 2.0 * before


def test_what_is_known_does_not_travel() -> None:
    recent, pose = Recent(length), np.ones((4, 3))
    assert recent(pose) == 12.0**0.5
    again = pickle.loads(pickle.dumps(recent))
    assert again._known is None and again(pose) == recent(pose)
