"""Counts of several meshes in one space, per mesh and together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair.intersect.ignored import CollapsedPoseError
from dtrepair.intersect.scene_counts import SceneCounter
from tests.meshes import grid, icosphere


def two_sheets(offset: float = 0.1) -> tuple[list[NDArray[np.float64]], list[NDArray[np.int32]]]:
    """A horizontal and a vertical sheet that cross, as two meshes."""
    points, faces = grid(4, 4)
    upright = np.stack([points[:, 0], np.full(len(points), 0.5 + offset), points[:, 1] - 0.4], 1)
    return [points, upright], [faces, faces]


def test_pairs_between_meshes() -> None:
    points, faces = two_sheets()
    found = SceneCounter(points, faces)(points)
    assert found.total.pairs == found.total.inter_pairs > 0
    assert [count.pairs for count in found.each] == [found.total.pairs] * 2
    assert sum(count.triangles for count in found.each) == found.total.triangles
    assert [int(mask.sum()) for mask in found.intersecting] == [c.triangles for c in found.each]


@pytest.mark.parametrize(("mode", "share"), [("both", 1), ("inter", 1), ("self", 0)])
def test_mode(mode: Any, share: float) -> None:
    points, faces = two_sheets()
    everything = SceneCounter(points, faces)(points).total.pairs
    assert SceneCounter(points, faces, mode=mode)(points).total.pairs == share * everything


def test_one_mesh_of_two_sheets_has_self_intersections_only() -> None:
    points, faces = two_sheets()
    both = np.concatenate(points)
    joined = np.concatenate([faces[0], faces[1] + len(points[0])])
    found = SceneCounter([both], [joined])([both])
    assert found.total.inter_pairs == 0
    assert found.total.pairs == SceneCounter(points, faces)(points).total.pairs


def test_meshes_that_touch_count_although_their_vertices_coincide() -> None:
    """Welding joins the seams of one mesh, never two meshes."""
    points, faces = icosphere(1)
    apart = SceneCounter([points, points], [faces, faces])
    assert apart([points, points]).total.inter_pairs >= len(faces)
    seams, cut = points[faces.reshape(-1)], np.arange(3 * len(faces)).reshape(-1, 3)
    whole = SceneCounter([seams], [cut.astype(np.int32)])
    assert whole([seams]).total.pairs == 0


def test_a_mesh_at_one_point_has_collapsed_although_its_vertices_are_one() -> None:
    points, faces = icosphere(4)  # 5,120 triangles, 13 million pairs
    counter = SceneCounter([points], [faces])
    assert counter([points]).total.pairs == 0
    for place in (0.0 * points, 0.0 * points + [1.0, 2.0, 3.0]):
        with pytest.raises(CollapsedPoseError, match="of its 5,120 triangles lie at one place"):
            counter([place])


def test_what_is_hidden_by_a_scale_of_nothing_is_no_fault() -> None:
    points, faces = icosphere(2)
    assert SceneCounter([points], [faces])([0.0 * points]).total.pairs == 0


def test_unknown_mode_is_refused() -> None:
    points, faces = two_sheets()
    with pytest.raises(ValueError, match="mode: expected one of self, inter, both, got 'all'"):
        SceneCounter(points, faces, mode="all")
