"""Figures and warnings of a transfer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dtrepair.transfer import Transfer, examine, identity_pairs, match_triangles, measure_coverage
from dtrepair.transfer.report import REMEDIES, Concern, residuals
from tests.meshes import icosphere, torus


def simple(**options: Any) -> tuple[NDArray[np.float64], Transfer]:
    points, faces = icosphere(2)
    points = points * np.array([1.0, 1.5, 0.8])
    return points, Transfer(points, faces, points, faces, identity_pairs(faces), **options)


def test_an_exact_transfer_has_no_residual_and_no_warning() -> None:
    points, transfer = simple()
    poses = np.stack([points, points @ Rotation.from_rotvec([0, 1.0, 0]).as_matrix().T])
    report = examine(transfer, poses, transfer(poses))
    assert report.residual_max < 1e-10 and report.flipped == 0.0
    assert report.unit_ratio == pytest.approx(1.0) and report.rest_error < 1e-11
    assert report.turn < 1e-5
    assert report.warnings == ()
    assert report.coverage.unmatched == 0 and report.coverage.source_used == 1.0


def test_the_residual_is_the_gradient_that_is_missing() -> None:
    points, transfer = simple()
    # Twice the size where the rest was asked for: the gradient is off by the identity in the plane.
    found = residuals(transfer, points[None], 2.0 * points[None])
    np.testing.assert_allclose(found, np.sqrt(2.0), rtol=1e-12)


def test_a_pose_in_other_units_is_reported() -> None:
    points, transfer = simple()
    for factor, told in ((100.0, True), (0.5, True), (1.2, False)):
        report = examine(transfer, factor * points[None], transfer(factor * points[None]))
        assert report.unit_ratio == pytest.approx(factor, rel=1e-9)
        assert (report.concerns == (Concern.UNITS,)) is told
        assert any("other units" in warning for warning in report.warnings) is told


def test_rests_that_face_other_ways_are_reported() -> None:
    points, faces = icosphere(2)
    points = points * np.array([1.0, 1.5, 0.8])
    turn = Rotation.from_rotvec([np.pi / 2, 0, 0]).as_matrix()
    for rotation, told in ((None, True), (turn, False)):
        transfer = Transfer(
            points, faces, points @ turn.T, faces, identity_pairs(faces), rotation=rotation
        )
        report = examine(transfer, points[None], transfer(points[None]))
        assert report.turn == pytest.approx(90.0 if told else 0.0, abs=1e-4)
        assert (report.concerns == (Concern.TURN,)) is told
        assert any("90 degrees apart" in warning for warning in report.warnings) is told


def test_triangles_turned_inside_out_are_reported() -> None:
    points, transfer = simple()
    mirrored = points * np.array([1.0, -1.0, 1.0])
    report = examine(transfer, points[None], mirrored[None])
    assert report.flipped > 0.5
    assert any("inside out" in warning for warning in report.warnings)


def test_coverage_counts_holes_by_number_area_and_patch() -> None:
    points, faces = icosphere(2)
    left = points[faces].mean(axis=1)[:, 0]
    covered = identity_pairs(faces)[(left < 0.8) & (left > -0.9)]
    coverage = measure_coverage(covered, faces, points, faces)
    assert coverage.unmatched == len(faces) - len(covered)
    assert coverage.largest_hole == int((left >= 0.8).sum())
    assert coverage.unmatched_part == pytest.approx(coverage.unmatched_area, rel=0.2)
    assert coverage.source_used == len(covered) / len(faces)
    assert coverage.concerns == (Concern.UNMATCHED,)
    assert "have no partner" in coverage.warnings[0]


def test_a_host_names_its_own_remedies() -> None:
    points, faces = icosphere(2)
    coverage = measure_coverage(identity_pairs(faces)[:200], faces, points, faces)
    (sentence,) = coverage.sentences({**REMEDIES, Concern.UNMATCHED: "press Pair"})
    assert sentence.endswith("they follow their neighbours: press Pair")
    assert coverage.warnings[0].endswith(": add markers there")


def test_an_ill_conditioned_system_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    points, transfer = simple()
    placed = transfer.placement
    monkeypatch.setattr(transfer, "placement", lambda *arguments: placed(*arguments) * (1.0 + 1e-4))
    report = examine(transfer, points[None], points[None])
    assert any("ill-conditioned" in warning for warning in report.warnings)


def test_results_of_another_transfer_are_refused() -> None:
    points, transfer = simple()
    with pytest.raises(ValueError, match=r"result should have shape \(1, 162, 3\)"):
        examine(transfer, points[None], points[None, :-1])
    source, target = torus(24, 12), torus(30, 14)
    other = Transfer(*source, *target, match_triangles(*source, *target))
    with pytest.raises(ValueError, match="result should have shape"):
        examine(other, source[0][None], source[0][None])


def test_long_animations_are_sampled_evenly_with_both_ends() -> None:
    points, transfer = simple()
    scales = np.linspace(1.0, 1.4, 101)
    poses = scales[:, None, None] * points
    report = examine(transfer, poses, poses.astype(np.float32), samples=3)
    assert report.unit_ratio == pytest.approx(1.2, rel=1e-9)
    with pytest.raises(ValueError, match="got 101 frames, 0 samples"):
        examine(transfer, poses, poses, samples=0)
    with pytest.raises(ValueError, match="got 0 frames"):
        examine(transfer, poses[:0], poses[:0])
