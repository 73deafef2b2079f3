"""The running jitter is the jitter of the whole clip."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.numerics.jitter_meter import JitterMeter
from dtrepair.numerics.metrics import jitter


def measured(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    meter = JitterMeter()
    for a, b in zip(before, after, strict=True):
        meter.add(a, b)
    return meter.value


def test_equals_the_figure_of_the_whole_clip() -> None:
    random = np.random.default_rng(3)
    before = random.normal(size=(7, 20, 3))
    after = before + 0.01 * random.normal(size=before.shape)
    assert measured(before, after) == pytest.approx(jitter(before, after), rel=1e-12)
    assert measured(before, after) > 1e-3


def test_steady_corrections_have_none() -> None:
    before = np.random.default_rng(4).normal(size=(5, 9, 3))
    ramp = np.arange(5)[:, None, None] * np.array([0.1, 0, 0])
    assert measured(before, before + ramp) == pytest.approx(0, abs=1e-14)
    assert measured(before[:2], before[:2] + 1) == 0.0
