"""Whole frames of a stage."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pxr import Usd

from tests.present import present
from usd_io.frame_grid import MOST_ADDED_FRAMES, FrameGrid, frame_grid


def filled(*times: float, grid: FrameGrid | None = None) -> list[float]:
    return list(present((grid or FrameGrid()).filled(np.array(times))))


def test_whole_frames_between_samples_are_added() -> None:
    assert filled(0.0, 3.0) == [0.0, 1.0, 2.0, 3.0]
    assert filled(-1.5, 1.25) == [-1.5, -1.0, 0.0, 1.0, 1.25]
    assert filled(2.0, 1.0) == [1.0, 2.0]
    assert filled(1.25) == [1.25] and filled() == []


def test_a_sample_within_rounding_stands_for_its_frame() -> None:
    near = 3.0 * 0.1 / 0.15
    assert near != 2.0 and abs(near - 2.0) < 1e-9
    assert filled(0.0, near, 3.0) == [0.0, 1.0, near, 3.0]
    assert filled(0.0, 1.001, 2.0) == [0.0, 1.0, 1.001, 2.0]
    assert filled(0.1 * 3 - 0.3, 2.0)[1:] == [1.0, 2.0]


def test_frames_may_be_other_steps_than_one() -> None:
    assert filled(0.0, 500.0, grid=FrameGrid(200.0)) == [0.0, 200.0, 400.0, 500.0]
    assert filled(0.0, 1.0, grid=FrameGrid(0.25, 0.1)) == pytest.approx(
        [0.0, 0.1, 0.35, 0.6, 0.85, 1.0]
    )


def test_a_key_far_off_adds_nothing() -> None:
    for far in (1e9, -1e300, np.inf):
        assert FrameGrid().filled(np.array([0.0, far])) is None
    most = float(MOST_ADDED_FRAMES)
    assert len(filled(0.0, most + 1.0)) == MOST_ADDED_FRAMES + 2
    assert FrameGrid().filled(np.array([0.0, most + 2.0])) is None
    every = np.arange(3.0 * most)
    assert filled(*every) == every.tolist()  # nothing is added there


@pytest.mark.parametrize(
    "metadata, grid",
    [
        ({}, FrameGrid()),
        ({"timeCodesPerSecond": 30.0}, FrameGrid()),
        ({"framesPerSecond": 25.0}, FrameGrid()),
        ({"timeCodesPerSecond": 25.0, "framesPerSecond": 25.0}, FrameGrid()),
        ({"timeCodesPerSecond": 4800.0, "framesPerSecond": 24.0}, FrameGrid(200.0)),
        (
            {
                "timeCodesPerSecond": 1.0,
                "framesPerSecond": 25.0,
                "startTimeCode": 0.5,
                "endTimeCode": 2.0,
            },
            FrameGrid(0.04, 0.5),
        ),
        ({"timeCodesPerSecond": 24.0, "framesPerSecond": 0.0}, FrameGrid()),
    ],
)
def test_frames_are_counted_as_usdview_does(metadata: dict[str, Any], grid: FrameGrid) -> None:
    stage = Usd.Stage.CreateInMemory()
    for name, value in metadata.items():
        stage.SetMetadata(name, value)
    assert frame_grid(stage) == grid
