"""The published loop on meshes made in code: it cleans, keeps the best, and never trusts NaN."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dtrepair.device import DeviceQueue
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import extent
from dtrepair.numerics.operators import cotangent_laplacian
from dtrepair.repair.paper.descent import Descent, triangle_counts
from dtrepair.repair.paper.diffusion import BodyDiffusion, Diffusion, SparseOperator
from dtrepair.repair.paper.gpu_operators import RowOperator
from dtrepair.repair.paper.optimizer import (
    GradientDescent,
    Moments,
    Optimizer,
    OptimizerOptions,
    start,
)
from tests.meshes import Mesh, bent_tube, icosphere, torus


def unit(mesh: Mesh) -> Mesh:
    """The mesh scaled to unit size."""
    points, faces = mesh
    return points / extent(points), faces


def make(mesh: Mesh, **options: Any) -> tuple[Descent, torch.Tensor]:
    """The descent of a mesh and its points (1, V, 3)."""
    points, faces = mesh
    laplacian = cotangent_laplacian(points, faces)
    detector = Detector(points, faces)
    descent = Descent(
        faces=torch.from_numpy(faces.astype(np.int64)),
        detect=detector,
        diffusion=Diffusion(laplacian),
        laplacian=SparseOperator(laplacian),
        **options,
    )
    return descent, torch.from_numpy(points)[None]


def crossing_tube() -> Mesh:
    """A tube bent past itself: its ends cross."""
    return unit(bent_tube(6.6, around=16, along=60, radius=0.08))


def dented_torus() -> Mesh:
    """A torus whose hole is closed by its own tube."""
    points, faces = torus(40, 20, radius=1.0, tube_radius=0.4)
    points[:, 0] *= np.where(np.abs(points[:, 0]) < 1.0, 0.6, 1.0)
    return unit((points, faces))


@pytest.mark.parametrize("optimizer", OptimizerOptions().by_name.values(), ids=str)
def test_crossing_tube_becomes_clean(optimizer: Optimizer) -> None:
    mesh = crossing_tube()
    descent, points = make(mesh, optimizer=optimizer)
    result = descent(points)
    before = int(result.history[0, 0])
    assert before > 20
    assert int(result.triangles[0]) == 0
    assert len(descent.detect(result.points)) == 0
    assert int(result.iterations[0]) == len(result.history) - 1 <= 60
    # It is still the same tube: no vertex moved by a third of its size.
    assert (result.points - points).norm(dim=-1).max() < 0.33


def test_clean_input_comes_back_unchanged() -> None:
    descent, points = make(unit(icosphere(2)))
    result = descent(points)
    assert torch.equal(result.points, points)
    assert result.history.tolist() == [[0]]
    assert result.iterations.tolist() == [0] and not result.diverged.any()


def test_batch_equals_single_frames_and_input_is_untouched() -> None:
    descent, points = make(crossing_tube(), iterations=12)
    straight = torch.from_numpy(unit(bent_tube(3.0, around=16, along=60, radius=0.08))[0])[None]
    batch = torch.cat([points, straight, points * 0.9])
    kept = batch.clone()
    together = descent(batch)
    assert torch.equal(batch, kept)
    for frame in range(3):
        alone = descent(batch[frame : frame + 1])
        assert torch.equal(alone.points[0], together.points[frame])
        assert alone.triangles[0] == together.triangles[frame]
        assert alone.iterations[0] == together.iterations[frame]
    # The clean frame is measured once.
    assert (together.history[1:, 1] == -1).all() and together.history[0, 1] == 0


def test_runs_repeat_to_the_bit() -> None:
    descent, points = make(crossing_tube(), iterations=8)
    assert torch.equal(descent(points).points, descent(points).points)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_frame_that_is_not_finite_never_counts_as_clean(bad: float) -> None:
    descent, points = make(crossing_tube(), iterations=5)
    broken = points.clone()
    broken[0, 3, 1] = bad
    result = descent(torch.cat([broken, points]))
    assert result.diverged.tolist() == [True, False]
    assert result.triangles[0] == -1
    assert torch.equal(result.points[1], descent(points).points[0])


@pytest.mark.parametrize("jump", [torch.inf, 100.0], ids=["infinite", "far apart"])
def test_a_diverging_run_keeps_its_best_iterate(jump: float) -> None:
    class Exploding:
        moments_between = False

        def __call__(
            self, moments: Moments, gradient: torch.Tensor
        ) -> tuple[torch.Tensor, Moments]:
            step = moments.step + 1
            # Vertices that fly apart no longer intersect: that is no result either.
            away = jump * torch.arange(1, gradient.shape[1] + 1)[None, :, None]
            return torch.where(step > 2, away, 2.0 * gradient), moments._replace(step=step)

    descent, points = make(crossing_tube(), optimizer=Exploding())
    result = descent(points)
    assert result.diverged.tolist() == [True]
    assert (result.points - points).abs().max() < 1.0
    assert int(result.triangles[0]) == int(result.history[:, 0].min()) > 0


def test_best_iterate_is_by_triangles_not_pairs() -> None:
    # Three pairs over three triangles, then two pairs over four: the first is better, and it stays
    # the best when another is as good: it is nearer to the input.
    three = [(0, 0, 1), (0, 0, 2), (0, 1, 2)]
    script = [three, [(0, 0, 1), (0, 2, 3)], three]
    calls = iter(script)
    descent, points = make(unit(icosphere(1)), iterations=2)
    descent = replace(descent, detect=lambda _: np.array(next(calls), dtype=np.int32))
    result = descent(points)
    assert result.history[:, 0].tolist() == [3, 4, 3]
    assert result.iterations.tolist() == [0] and torch.equal(result.points, points)


def test_counts_are_distinct_triangles_by_frame() -> None:
    pairs = torch.tensor([[0, 1, 2], [0, 1, 3], [2, 0, 4]])
    assert triangle_counts(pairs, 3, 5).tolist() == [3, 0, 2]


def test_shape_term_keeps_the_surface_flatter() -> None:
    bent = []
    for regularization in (0.0, 1e6):
        optimizer = GradientDescent(rate=1.0)
        descent, points = make(crossing_tube(), regularization=regularization, optimizer=optimizer)
        pairs = torch.from_numpy(descent.detect(points)).long()
        target, moments, current = descent.laplacian(points), start(points), points
        for _ in range(10):
            current, moments = descent.step(current, pairs, target, moments)
        bent.append(float(descent.laplacian(current - points).norm()))
    assert 0 < bent[1] < 0.99 * bent[0]


def two_bodies(mobility: list[float]) -> tuple[Descent, torch.Tensor, int]:
    """A small ball half inside a big one, each with its own diffusion."""
    ball, ball_faces = icosphere(3, 0.25)
    small, small_faces = icosphere(2, 0.1)
    points = np.concatenate([ball, small + np.array([0.3, 0.02, 0.01])])
    faces = np.concatenate([ball_faces, small_faces + len(ball)]).astype(np.int32)
    laplacian = cotangent_laplacian(points, faces)
    parts = [(0, len(ball), 99.0), (len(ball), len(points), 999.0)]
    bodies = [(a, b, Diffusion(laplacian[a:b, a:b], strength=s)) for a, b, s in parts]
    per_vertex = torch.tensor(mobility).repeat_interleave(
        torch.tensor([len(ball), len(points) - len(ball)])
    )
    detector = Detector(points, faces)
    descent = Descent(
        faces=torch.from_numpy(faces.astype(np.int64)),
        detect=detector,
        diffusion=BodyDiffusion(bodies, mobility=per_vertex),
        laplacian=SparseOperator(laplacian),
    )
    return descent, torch.from_numpy(points)[None], len(ball)


@pytest.mark.parametrize("mobility", [[1.0, 1.0], [0.0, 1.0], [1.0, 0.0]], ids=str)
def test_two_bodies_separate_and_a_collider_stays(mobility: list[float]) -> None:
    descent, points, first = two_bodies(mobility)
    result = descent(points)
    assert result.history[0, 0] > 0 and result.triangles[0] == 0
    moved = (result.points - points)[0].norm(dim=-1)
    for part, free in zip((moved[:first], moved[first:]), mobility, strict=True):
        assert (part.max() > 0) == (free > 0)


def test_direction_control_moves_the_region_where_the_user_wants() -> None:
    descent, points, first = two_bodies([0.0, 1.0])
    region = (descent.faces >= first).all(dim=1)
    for wanted in np.eye(3):
        direction = torch.zeros(len(region), 3, dtype=torch.float64)
        direction[region] = torch.from_numpy(wanted)
        result = replace(descent, direction=direction)(points)
        assert result.triangles[0] == 0
        moved = (result.points - points)[0, first:].mean(dim=0)
        # Left alone it leaves along x, where it is nearest to the surface.
        assert int(moved.abs().argmax()) == int(wanted.argmax())


def test_precomputed_operators_give_the_same_result() -> None:
    # Few iterations: touching triangles amplify rounding, as in every contact problem.
    descent, points = make(crossing_tube(), optimizer=GradientDescent(rate=2.0), iterations=4)
    assert isinstance(descent.diffusion, Diffusion)
    assert isinstance(descent.laplacian, SparseOperator)
    other = replace(
        descent,
        diffusion=descent.diffusion.dense(device="cpu"),
        laplacian=RowOperator(descent.laplacian.matrix, DeviceQueue("cpu")),
    )
    result, expected = other(points), descent(points)
    assert result.iterations[0] == expected.iterations[0] > 0
    assert (result.points - expected.points).abs().max() < 1e-9


def test_brute_force_agrees_that_the_bodies_are_apart() -> None:
    descent, points, first = two_bodies([1.0, 1.0])
    result = descent(points)
    clouds = result.points[0, :first], result.points[0, first:]
    # Both balls stay nearly round, so the gap between their surfaces can be read off their centres.
    centres = [cloud.mean(dim=0) for cloud in clouds]
    radii = [
        (cloud - centre).norm(dim=1).mean() for cloud, centre in zip(clouds, centres, strict=True)
    ]
    assert (centres[1] - centres[0]).norm() > 0.9 * sum(radii)


def test_pairs_of_a_mesh_are_each_counted_once() -> None:
    descent, points = make(dented_torus(), iterations=0)
    pairs = descent.detect(points)
    result = descent(points)
    assert int(result.triangles[0]) == len({t for _, *both in pairs.tolist() for t in both})
    assert all(a < b for _, a, b in pairs.tolist())
    assert len(set(map(tuple, pairs.tolist()))) == len(pairs)


@pytest.mark.parametrize("optimizer", OptimizerOptions().by_name.values(), ids=str)
def test_published_knot_becomes_clean(shared_data: Path, optimizer: Optimizer) -> None:
    mesh = read_mesh(shared_data / "misc" / "trefoil_knot.obj")
    descent, points = make(unit((mesh.points, mesh.faces())), optimizer=optimizer)
    result = descent(points)
    # Jang et al. 2025 need 37 to 83 iterations on average where zero is reached.
    assert result.history[0, 0] > 300 and result.triangles[0] == 0
