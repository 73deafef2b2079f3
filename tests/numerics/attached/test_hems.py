"""What a garment that is attached by its hems does not hold."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attached.attachment_options import AttachmentOptions
from dtrepair.numerics.attached.hems import HemOptions, clear_of_hems
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference, Ties
from dtrepair.numerics.geometry import FloatArray
from tests.meshes import joined, tube


def clear(near: float, beyond: float, away: float, far: float = 0.0) -> float:
    """The area beyond the reach of a hem that is clear of a garment of size 1, away from it."""
    areas = np.array([near, beyond, far])
    within = np.array([True, False, False])
    found = clear_of_hems(
        within, np.array([False, False, True]), np.array([0.02, away, 0.5]), areas, 1.0
    )
    assert not found[0] and not found[2]
    return float(areas[found].sum())


def test_thighs_under_a_coat_are_clear_of_it() -> None:
    assert clear(near=10, beyond=100, away=0.03) == 100


def test_arms_in_a_tight_suit_are_not() -> None:
    assert clear(near=10, beyond=100, away=0.01) == 0


def test_nor_is_what_meets_an_open_part_mostly_where_it_is_attached() -> None:
    assert clear(near=10, beyond=60, away=0.03) == 0
    assert clear(near=10, beyond=61, away=0.03) == 61
    # What hangs off it farther than anything at the contact is no seed at all.
    assert clear(near=10, beyond=60, away=0.03, far=100) == 0


def in_a_coat(gap: float, beyond: float) -> tuple[FloatArray, Ties]:
    """A body in an open coat that meets it in a collar, and what ties the two."""
    body, coat = tube(24, 80, 0.2, 4.0), tube(24, 40, 1.0, 2.0)
    height = coat[0][:, 2]
    radius = 0.2 + gap - (gap + 0.03) * np.clip((height - 0.7) / 0.2, 0.0, 1.0)
    shell = coat[0] * np.stack([radius, radius, np.ones_like(radius)], axis=1)
    points, faces = joined(body, (shell, coat[1]))
    reference = Reference(points, Detector(points, faces)(points))
    options = AttachmentOptions(hangs=1.0, hems=HemOptions(beyond=beyond))
    found = find_attachments(faces, len(points), [reference], options=options)
    return points, found.ties


@pytest.mark.parametrize(("gap", "beyond", "held"), [(0.1, 2, 0), (0.1, 99, 1), (0.01, 2, 1)])
def test_a_body_is_tied_to_the_collar_of_a_coat_and_to_all_of_a_tight_one(
    gap: float, beyond: float, held: int
) -> None:
    points, ties = in_a_coat(gap, beyond)
    of_body = np.linalg.norm(points[ties.vertices, :2], axis=1) < 0.2001
    height = points[ties.vertices[of_body], 2]
    assert (height > 0.7).any() and (height < -0.5).any() == held
