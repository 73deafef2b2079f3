"""Bodies of a high diffusion keep their shape in clips."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray, unique_edges
from dtrepair.numerics.metrics import edge_log_ratio
from dtrepair.repair.clip.mend_frames import LendFramesOptions
from dtrepair.repair.clip.restore_shape import RestoreShapeOptions
from dtrepair.repair.clip.window_method import WindowMethod, WindowOptions
from dtrepair.repair.full.method import solve_alone
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import icosphere, joined

BALL, BALL_FACES = icosphere(2)
ROD, ROD_FACES = BALL * np.array([0.2, 0.2, 0.8]), BALL_FACES
USUAL, NEVER = RestoreShapeOptions(), RestoreShapeOptions(cycles=0, soft_cycles=0)
# However many frames pushing leaves dirty, they are mended one by one.
PUSHED = LendFramesOptions(share=1.0)


def repaired(
    diffusion: float,
    mobility: FloatArray,
    depth: FloatArray,
    restore: RestoreShapeOptions = USUAL,
    lend: LendFramesOptions = PUSHED,
) -> tuple[FloatArray, FloatArray]:
    """A clip (T, V, 3) of a rod that dips into a ball by `depth` (T,), and the clean result."""
    count = len(BALL)
    rest, faces = joined((BALL, BALL_FACES), (ROD, ROD_FACES))
    bodies = [BodyRange(0, count, 99.0), BodyRange(count, len(rest), diffusion)]
    surface = Surface(rest, faces, bodies=bodies, mobility=mobility)
    poses = np.repeat(rest[None], len(depth), axis=0)
    poses[:, count:] += np.array([0.3, 0.1, 1.75]) - depth[:, None, None] * [0.0, 0.0, 1.0]
    poses /= surface.size
    options = WindowOptions(restore=restore, lend=lend)
    method = WindowMethod(surface, solve_alone, options=options)
    result = method(poses, np.arange(float(len(poses))), WorkerPool())
    assert result is not None
    assert all(len(surface.contacts.pairs(pose)) == 0 for pose in result)
    return poses, result


@cache
def bending(
    diffusion: float,
    mobility: float = 0.0,
    restore: RestoreShapeOptions = USUAL,
    lend: LendFramesOptions = PUSHED,
) -> float:
    """Root mean square of the rod's edge changes in a clip that is repaired clean."""
    depth = 0.9 * np.cos(np.linspace(-1.6, 1.6, 7))
    mobilities = np.repeat([mobility, 1.0], len(BALL))
    edges, rod = unique_edges(ROD_FACES), slice(len(BALL), None)
    poses = zip(*repaired(diffusion, mobilities, depth, restore, lend), strict=True)
    changes = [edge_log_ratio(before[rod], after[rod], edges) for before, after in poses]
    assert sum(change > 0 for change in changes) > 3
    return float(np.sqrt(np.mean(np.square(changes))))


@pytest.mark.parametrize("mobility", [0.0, 1.0])
def test_a_stiff_body_hardly_bends(mobility: float) -> None:
    assert bending(999.0, mobility) < 0.8 * bending(999.0, mobility, NEVER)


def test_what_stretches_a_soft_body_is_evened_out() -> None:
    assert bending(99.0) < 0.95 * bending(99.0, restore=NEVER)


def test_what_is_solved_frame_by_frame_is_hardly_stretched() -> None:
    assert bending(99.0, lend=LendFramesOptions(share=0.0)) < 0.5 * bending(99.0)


def test_a_soft_body_that_is_hardly_stretched_is_left_alone() -> None:
    patient = RestoreShapeOptions(little=1.0)
    assert bending(99.0, restore=patient) == bending(99.0, restore=NEVER)


def test_fixed_vertices_of_a_stiff_body_hold() -> None:
    fixed = np.concatenate([np.zeros(len(BALL), dtype=bool), ROD[:, 2] > 0.6])
    depth = 0.5 * np.cos(np.linspace(-1.6, 1.6, 6))
    poses, result = repaired(999.0, np.where(fixed, 0.0, 1.0), depth)
    assert np.array_equal(result[:, fixed], poses[:, fixed])
    assert (result[3, len(BALL) :] != poses[4, len(BALL) :]).any()
