"""A pile of objects that all move, soft and rigid: one loop, nothing left."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, SceneRepairer, Status
from dtrepair.numerics.geometry import unique_edges
from dtrepair.repair.full.biharmonic_fill import Candidate
from dtrepair.repair.full.phases import PhaseOptions, Phases
from dtrepair.repair.full.push import PushOptions, _of_length
from dtrepair.repair.full.relax import RelaxOptions, relax
from dtrepair.repair.independent import repair_poses
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.surface.defects import find_defects
from dtrepair.repair.surface.surface import BodyRange, Surface
from dtrepair.repair.torn_poses import TornOptions, squeezed
from tests.exact_reference import exact_pairs
from tests.meshes import Mesh, icosphere, joined, torus


def pile(count: int = 6) -> list[Mesh]:
    """Balls, eggs, rods and rings, each in its neighbours."""
    ball, faces = icosphere(2, 0.5)
    ring, ring_faces = torus(24, 10, 0.38, 0.14)
    kinds = [(ball, faces), (ball * [1.3, 0.7, 0.8], faces), (ring, ring_faces)]
    cells = np.stack(np.meshgrid([0, 1, 2], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
    shifts = 0.8 * cells + 0.05 * np.random.default_rng(0).normal(size=cells.shape)
    chosen = [kinds[index % len(kinds)] for index in range(count)]
    return [
        (points + shift, own) for (points, own), shift in zip(chosen, shifts[:count], strict=True)
    ]


@pytest.mark.parametrize("rigid", [(), (0, 2, 3), (0, 1, 2, 3, 4, 5)])
def test_six_objects_come_apart(rigid: tuple[int, ...]) -> None:
    meshes = pile()
    bodies = [Body(*mesh, rigid=index in rigid) for index, mesh in enumerate(meshes)]
    results = SceneRepairer(bodies)([points for points, _ in meshes])
    assert all(result.status is Status.CLEAN for result in results)
    assert sum(result.before.inter_pairs for result in results) > 200
    after = [(result.points, faces) for result, (_, faces) in zip(results, meshes, strict=True)]
    assert len(exact_pairs(*joined(*after))) == 0
    for index in rigid:
        edges = unique_edges(meshes[index][1])
        lengths = [
            np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
            for points in (meshes[index][0], results[index].points)
        ]
        assert np.abs(lengths[1] / lengths[0] - 1.0).max() < 1e-5


def test_one_contact_does_not_make_the_others_wait() -> None:
    meshes = pile()
    points, faces = joined(*meshes)
    starts = np.cumsum([0, *(len(mesh[0]) for mesh in meshes)]).tolist()
    ranges = [BodyRange(starts[k], starts[k + 1], 99.0) for k in range(6)]
    surface = Surface(points, faces, bodies=ranges)
    lengths = np.array([10.0, 1.0, 1.0, 1.0, 0.5, 0.0])
    direction = np.zeros_like(points)
    direction[:, 0] = lengths[surface.body_of_vertex]
    moved = _of_length(surface, direction, 0.01, PushOptions())
    assert moved is not None
    first = moved[starts[:-1], 0]
    assert np.allclose(first, [0.01, 0.01, 0.01, 0.01, 0.005, 0.0])
    pair = Surface(*joined(*meshes[:2]), bodies=ranges[:2])
    moved = _of_length(pair, direction[: starts[2]], 0.01, PushOptions())
    assert moved is not None
    assert np.allclose(moved[[0, starts[1]], 0], [0.01, 0.001])
    assert _of_length(pair, np.full((starts[2], 3), np.nan), 0.01, PushOptions()) is None


def test_a_body_that_has_far_to_go_does_not_hold_up_the_return_of_others() -> None:
    """Relaxing by one cycle: in a pile each body may go as far as a step, else all share one."""
    for count, alone in ((4, True), (2, False)):
        points, faces = joined(
            *[(icosphere(2, 0.5)[0] + 3.0 * k, icosphere(2)[1]) for k in range(count)]
        )
        size = len(points) // count
        bodies = [BodyRange(k * size, (k + 1) * size, 99.0) for k in range(count)]
        surface = Surface(points, faces, bodies=bodies)
        shifts = np.repeat([10.0, *[0.5] * (count - 1)], size)[:, None] * [0.0, 0.0, 0.002]
        reach, options = np.ones(len(points)), RelaxOptions(step=0.001, first=1.0)
        pose = surface.rest + shifts
        back, _ = relax(
            surface, surface.rest, pose, cycles=1, folds=0, reach=reach, options=options
        )
        moved = np.linalg.norm(back - pose, axis=1)[[0, size]]
        assert moved[0] == pytest.approx(options.pile_step * 0.001 if alone else 0.001, rel=0.05)
        assert (moved[1] > 0.9 * 0.001) == alone


def test_what_is_pressed_from_many_sides_is_not_led_out() -> None:
    ball, faces = icosphere(2, 0.5)
    sides = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, 1)])
    for count, pressed in ((2, False), (4, True)):
        meshes = [(ball, faces), *((ball + 1.004 * way, faces) for way in sides[:count])]
        scene = make_scene([Body(*mesh) for mesh in meshes], RepairOptions())
        points = np.concatenate([mesh[0] for mesh in meshes])
        mesh = WeldedMeshes(scene)([scene.weld(points)])
        torn = np.arange(count + 1) == 0
        assert squeezed(mesh, points, torn)[0] == pressed
        assert not squeezed(mesh, points, torn)[1:].any()


def test_only_what_has_a_way_out_is_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """All count as torn here: the ball in the middle is pressed by four others, these by one."""
    ball, faces = icosphere(2, 0.5)
    sides = 0.8 * np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, 1)])
    poses = [ball, *(ball + side for side in sides)]
    named: list[set[int]] = []

    def noted(
        scene: Any, mesh: Any, starts: Any, *_: Any, sheets: Iterable[int] = (), **more: Any
    ) -> Any:
        named.append(set(sheets))
        return starts

    monkeypatch.setattr("dtrepair.repair.torn_poses.separated_frames", noted)
    scene = make_scene([Body(points, faces) for points in poses], RepairOptions())
    options = IndependentOptions(torn=TornOptions(changed=0.0, pressed=0.05))
    repair_poses(scene, WeldedMeshes(scene), [poses], options=options)
    assert named == [set(), {1, 2, 3, 4}]


@pytest.mark.parametrize("left", [1, 2])
def test_what_few_bodies_have_left_is_insisted_on_at_once(
    monkeypatch: pytest.MonkeyPatch, left: int
) -> None:
    """Of two pairs of balls one is left crossing: no second step length for the other one."""
    ball, faces = icosphere(2, 0.5)
    places = np.array([(0, 0, 0), (0.9, 0, 0), (5, 0, 0), (5.9, 0, 0)])
    points, all_faces = joined(*[(ball + place, faces) for place in places])
    ranges = [BodyRange(k * len(ball), (k + 1) * len(ball), 99.0) for k in range(4)]
    surface = Surface(points, all_faces, bodies=ranges)
    phases = Phases(surface, surface.rest)
    steps: list[float] = []

    def run(step: float) -> Candidate:
        steps.append(step)
        found = surface.rest.copy()
        if left == 1:
            found[3 * len(ball) :] += np.array([0.2, 0.0, 0.0]) / surface.size
        phases.candidates.append(Candidate(found, find_defects(surface, found), 0.1, 0))
        return phases.candidates[-1]

    monkeypatch.setattr(phases, "run", run)
    best = phases.best()
    assert len(best.defects.crossings) == 0
    assert steps == list(PhaseOptions.first_steps[:left])
