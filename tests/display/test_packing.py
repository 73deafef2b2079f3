"""Arrays as text: what is packed comes back, and poses come back by adding up."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from dtrepair.display.packing import differences, packed, unpacked


@given(
    arrays(np.uint8, st.integers(0, 9)),
    arrays(np.uint16, st.integers(0, 9)),
    arrays(np.uint32, st.integers(0, 9)),
)
def test_packed_arrays_come_back(first: object, second: object, third: object) -> None:
    given_arrays = {"a": np.asarray(first), "b": np.asarray(second), "c": np.asarray(third)}
    found = unpacked(json.loads(json.dumps(packed(given_arrays))))
    for name, array in given_arrays.items():
        assert found[name].dtype == array.dtype and np.array_equal(found[name], array)


def test_poses_come_back_within_half_a_step() -> None:
    poses = np.random.default_rng(3).uniform(-1, 1, (5, 7, 3))
    step = 1 / 32000
    added = np.cumsum(differences(poses, step).astype(np.int64), axis=0).astype(np.uint16)
    assert np.abs(added.view(np.int16) * step - poses).max() <= 0.5 * step + 1e-12


def test_other_kinds_are_refused() -> None:
    with pytest.raises(KeyError, match="float64"):
        packed({"a": np.zeros(3)})
