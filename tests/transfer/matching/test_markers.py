"""Checks of marker pairs."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.transfer.matching.markers import checked_markers


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[0, 0, 0]], r"shape \(K, 2\)"),
        ([[0.5, 1.0]], "integers"),
        ([[0, 1], [9, 2]], "source vertices 0..8, got index 9 in marker 1"),
        ([[0, 1], [1, -4]], "target vertices 0..9, got index -4 in marker 1"),
        ([[4, 1], [3, 2], [4, 3]], "source vertex should have one marker.*vertex 4 .* 0 and 2"),
        ([[1, 7], [2, 7], [3, 1]], "target vertex should have one marker.*vertex 7 .* 0 and 1"),
    ],
)
def test_wrong_markers_are_refused(rows: list[list[float]], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        checked_markers(np.array(rows), 9, 10)
