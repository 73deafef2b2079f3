"""Relaxing: never dirty, never more distorted, at rest against what is in the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import displacements, distortion
from dtrepair.numerics.work import work_done
from dtrepair.repair.full import relax as module
from dtrepair.repair.full.biharmonic_fill import Filled
from dtrepair.repair.full.relax import RelaxOptions, relax
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import Surface
from tests.meshes import torus
from tests.repair.full.test_pull_back import POSES, crossings_and_folds, loosely_solved


@pytest.mark.parametrize("kind", POSES)
def test_relaxing_is_never_dirty_or_more_distorted(kind: str) -> None:
    surface, original, clean = loosely_solved(kind)
    folds = crossings_and_folds(surface, clean)[1]
    before = distortion(original, clean, surface.edges)
    reach = np.ones(surface.count)
    relaxed, cycles = relax(surface, original, clean, cycles=6, folds=folds, reach=reach)
    crossings, folds_left = crossings_and_folds(surface, relaxed)
    assert crossings == 0 and folds_left <= folds
    # More cycles than asked for only where volume is missing.
    assert 1 <= cycles <= RelaxOptions.more * 6
    assert cycles <= 6 or kind == "arm"
    assert distortion(original, relaxed, surface.edges) < 0.9 * before
    again, _ = relax(surface, original, clean, cycles=6, folds=folds, reach=reach)
    assert np.array_equal(again, relaxed)


def test_a_pose_with_nothing_in_the_way_returns() -> None:
    # A clean input bent far out of shape.
    points, faces = torus()
    surface = Surface(points, faces)
    original = surface.rest
    bent = original + 0.05 * np.sin(9 * original[:, [1, 2, 0]])
    assert crossings_and_folds(surface, bent) == (0, 0)
    reach = np.ones(surface.count)
    relaxed, _ = relax(surface, original, bent, cycles=12, folds=0, reach=reach)
    before = displacements(original, bent).max()
    assert displacements(original, relaxed).max() < 0.5 * before
    assert distortion(original, relaxed, surface.edges) < 0.2 * distortion(
        original, bent, surface.edges
    )


@pytest.mark.parametrize(("works", "expected"), [(lambda k: k % 2, 8), (lambda k: k < 2, 6)])
def test_relaxing_ends_when_cycles_fail_in_a_row(
    works: Callable[[int], bool], expected: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    surface, original, clean = loosely_solved("spheres")
    calls: list[int] = []
    solved = module.Relaxation._solved

    def sometimes(state: module.Relaxation, right: FloatArray) -> Filled | None:
        calls.append(len(calls))
        return solved(state, right) if works(calls[-1]) else None

    monkeypatch.setattr(module.Relaxation, "_solved", sometimes)
    reach, options = np.ones(surface.count), RelaxOptions(enough=-1.0, missing=1.0)
    _, cycles = relax(surface, original, clean, cycles=8, folds=0, reach=reach, options=options)
    assert cycles == len(calls) == expected


def test_relaxing_ends_when_so_much_work_is_done() -> None:
    surface, original, clean = loosely_solved("spheres")
    reach = np.ones(surface.count)

    def relaxed(until: float) -> tuple[FloatArray, int]:
        return relax(surface, original, clean, cycles=6, folds=0, reach=reach, until=until)

    same, none = relaxed(work_done() - 1.0)
    assert none == 0 and np.array_equal(same, clean)
    start = work_done()
    every = relaxed(np.inf)[1]
    assert 1 <= relaxed(1.5 * work_done() - 0.5 * start)[1] < every


def test_nothing_moves_beyond_the_reach_or_farther_than_the_step() -> None:
    points, faces = torus()
    surface = Surface(points, faces)
    bent = surface.rest + 0.05 * np.sin(9 * surface.rest[:, [1, 2, 0]])
    reach = (surface.rest[:, 0] > 0).astype(float)
    options = RelaxOptions(step=0.003, first=1.0)
    relaxed, _ = relax(surface, surface.rest, bent, cycles=1, folds=0, reach=reach, options=options)
    moved = np.linalg.norm(relaxed - bent, axis=1)
    assert moved.any() and not moved[reach == 0].any()
    assert moved.max() <= 0.003 * (1 + 1e-9)


def test_nothing_in_reach_stays() -> None:
    surface, original, clean = loosely_solved("spheres")
    reach = np.zeros(surface.count)
    relaxed, cycles = relax(surface, original, clean, cycles=3, folds=0, reach=reach)
    assert relaxed is clean and cycles == 0


def test_surfaces_come_to_rest_against_each_other() -> None:
    surface, original, clean = loosely_solved("spheres")
    reach = np.ones(surface.count)
    relaxed, _ = relax(surface, original, clean, cycles=12, folds=0, reach=reach)
    assert find_defects(surface, relaxed).rank == (0, 0)
    # What is left between them is a few margins, not the distance the push left.
    assert len(surface.contacts.close_pairs(relaxed, 0.005)) > 2 * len(
        surface.contacts.close_pairs(clean, 0.005)
    )
    assert displacements(original, relaxed).mean() < 0.8 * displacements(original, clean).mean()


def test_cycles_double_for_missing_volume_only() -> None:
    surface = Surface(*torus())
    reach = np.ones(surface.count)
    # Steps so short that no volume comes back, and so short that little does.
    options = RelaxOptions(step=1e-5)
    for shrunk, spent in ((0.9, 2 * options.more), (0.999, 2)):
        pose = shrunk * surface.rest
        _, cycles = relax(
            surface, surface.rest, pose, cycles=2, folds=0, reach=reach, options=options
        )
        assert cycles == spent
