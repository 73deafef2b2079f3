"""The law of chunks: however a clip is split, joined chunks are what one run writes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from dtrepair import RepairOptions
from dtrepair.pipeline import join_layers, repair_stage
from dtrepair.repair.clip import clip_options
from tests.command_line import OPEN, read_samples, tube_stage

NEAR = 6.3  # the ends just pass through each other
ANGLES = (OPEN, OPEN + 0.1, NEAR - 0.1, NEAR)  # work for few frames: the law is of windows


@pytest.fixture(autouse=True, scope="module")
def small_windows() -> Iterator[None]:
    """Windows of 8 frames that overlap by 2."""
    small = partial(clip_options.ClipOptions, window=8, overlap=2)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(clip_options, "ClipOptions", small)
        yield


@settings(max_examples=2, phases=[Phase.explicit, Phase.generate])
@given(st.lists(st.sampled_from(ANGLES), min_size=2, max_size=10), st.integers(2, 4))
@example([NEAR - 0.05 * (k % 4) for k in range(10)], 3)
def test_joined_chunks_are_one_run(
    tmp_path_factory: pytest.TempPathFactory, angles: list[float], count: int
) -> None:
    folder: Path = tmp_path_factory.mktemp("clip")
    stage, whole, joined = (str(folder / f"{name}.usdc") for name in ("clip", "whole", "joined"))
    tube_stage(Path(stage), angles)
    repair = partial(repair_stage, stage, options=RepairOptions(tighten=0), jobs=1)
    repair(whole)
    parts = [str(folder / f"part{number}.usdc") for number in range(1, count + 1)]
    for number, part in enumerate(parts, 1):
        repair(part, chunk=f"{number}/{count}")
    join_layers(parts, joined)
    one, other = read_samples(Path(whole)), read_samples(Path(joined))
    given = read_samples(Path(stage))
    assert (NEAR in angles) == any((one[time] != given[time]).any() for time in given)
    assert list(one) == list(other) == [float(k + 1) for k in range(len(angles))]
    assert all(np.array_equal(one[time], other[time]) for time in one)
