"""SceneRepairer: bodies that separate, colliders, modes and counts for each body."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions, RepairResult, SceneRepairer, Status
from dtrepair.geometry import FloatArray
from tests.exact_reference import exact_pairs
from tests.meshes import Mesh, crossing_tubes, icosphere, joined, torus

BALL, BALL_FACES = icosphere(2)
TUBES, TUBE_FACES = crossing_tubes(8, 20)


def placed(x: float, y: float = 0.0, scale: float = 1.0) -> Mesh:
    return scale * BALL[:, [1, 2, 0]] + np.array([x, y, 0.03]), BALL_FACES


PAIR = [(BALL, BALL_FACES), placed(1.5)]


def scene(meshes: list[Mesh], options: RepairOptions | None = None, **of: list) -> SceneRepairer:
    bodies = [
        Body(*mesh, **{name: values[index] for name, values in of.items()})
        for index, mesh in enumerate(meshes)
    ]
    return SceneRepairer(bodies, options=options)


def poses(meshes: list[Mesh]) -> list[FloatArray]:
    return [points for points, _ in meshes]


def check_counts(results: list[RepairResult], meshes: list[Mesh]) -> None:
    """The result's counts of every body are those of an independent count in integers."""
    owner = np.repeat(np.arange(len(meshes)), [len(faces) for _, faces in meshes])
    after = [(result.points, faces) for result, (_, faces) in zip(results, meshes, strict=True)]
    for state, name in ((meshes, "before"), (after, "after")):
        pairs = exact_pairs(*joined(*state))
        for index, result in enumerate(results):
            own = (owner[pairs] == index).any(axis=1)
            triangles = np.unique(pairs)
            inter = own & (owner[pairs[:, 0]] != owner[pairs[:, 1]])
            count = getattr(result, name)
            assert count.pairs == own.sum() and count.inter_pairs == inter.sum()
            assert count.triangles == (owner[triangles] == index).sum()


@pytest.mark.parametrize("diffusion", [(99.0, 99.0), (999.0, 99.0), (None, 999.0)])
def test_two_bodies_separate(diffusion: tuple[float | None, float]) -> None:
    results = scene(PAIR, diffusion=list(diffusion))(poses(PAIR))
    check_counts(results, PAIR)
    for result in results:
        assert result.before.inter_pairs == result.before.pairs > 20
        assert result.after.pairs == 0 and result.status is Status.CLEAN
        assert 0 < result.displacement_max < 0.3


@pytest.mark.parametrize("still", [0, 1])
def test_a_collider_keeps_every_bit(still: int) -> None:
    mobility = [1.0, 1.0]
    mobility[still] = 0.0
    results = scene(PAIR, mobility=mobility)(poses(PAIR))
    assert np.array_equal(results[still].points, PAIR[still][0])
    assert results[still].displacement_max == 0.0 < results[1 - still].displacement_max
    assert all(result.status is Status.CLEAN for result in results)
    check_counts(results, PAIR)


def test_the_less_mobile_body_moves_less() -> None:
    results = scene(PAIR, mobility=[0.2, 1.0])(poses(PAIR))
    assert all(result.status is Status.CLEAN for result in results)
    assert results[0].displacement_mean < 0.5 * results[1].displacement_mean


def test_two_colliders_cannot_be_separated() -> None:
    results = scene(PAIR, mobility=[0.0, 0.0])(poses(PAIR))
    for result, (points, _) in zip(results, PAIR, strict=True):
        assert np.array_equal(result.points, points)
        assert result.status is Status.UNCHANGED and result.before == result.after
    check_counts(results, PAIR)


def test_pins_of_a_body_hold() -> None:
    pins = [np.ones(len(BALL)), None]
    results = scene(PAIR, pin=pins)(poses(PAIR))
    assert np.array_equal(results[0].points, BALL)
    assert results[1].status is Status.CLEAN


def test_mode_chooses_the_contacts() -> None:
    # The first body meets itself, and the second meets the first.
    meshes = [(TUBES, TUBE_FACES), placed(0.0, 0.15, 0.3)]
    done = {
        mode: scene(meshes, RepairOptions(mode=mode))(poses(meshes))
        for mode in ("self", "inter", "both")
    }
    both = done["both"]
    check_counts(both, meshes)
    assert both[0].after.pairs == both[1].after.pairs == 0
    inter = both[1].before.pairs
    assert 0 < inter < both[0].before.pairs
    assert done["inter"][0].before.pairs == done["inter"][0].before.inter_pairs == inter
    assert done["self"][0].before.pairs == both[0].before.pairs - inter
    assert done["self"][1].before.pairs == 0
    own = exact_pairs(done["self"][0].points, TUBE_FACES)
    assert len(own) == done["self"][0].after.pairs == 0
    owner = np.repeat([0, 1], [len(TUBE_FACES), len(BALL_FACES)])
    left = [(done["inter"][k].points, meshes[k][1]) for k in (0, 1)]
    pairs = exact_pairs(*joined(*left))
    assert (owner[pairs[:, 0]] == owner[pairs[:, 1]]).all()
    # The ball meets nothing of itself: with "self" it stays as it is.
    assert np.array_equal(done["self"][1].points, meshes[1][0])


def test_a_body_that_meets_nothing_keeps_every_bit() -> None:
    meshes = [*PAIR, (torus()[0] + np.array([0.0, 9.0, 0.0]), torus()[1])]
    results = scene(meshes)(poses(meshes))
    assert np.array_equal(results[2].points, meshes[2][0])
    assert results[2].status is Status.CLEAN and results[2].before.pairs == 0
    assert all(result.status is Status.CLEAN for result in results)
    check_counts(results, meshes)


def test_bodies_that_touch_at_one_vertex_are_not_welded() -> None:
    # Vertices of two bodies at one place belong to two surfaces, and touching counts.
    lowest = int(np.argmin(BALL[:, 0]))
    highest = int(np.argmax(BALL[:, 0]))
    touching = BALL + BALL[highest] - BALL[lowest]
    meshes = [(BALL, BALL_FACES), (touching, BALL_FACES)]
    results = scene(meshes)(poses(meshes))
    assert results[0].before.inter_pairs > 0
    assert results[0].status is Status.CLEAN
    assert not np.array_equal(results[0].points[highest], results[1].points[lowest])


def test_scenes_are_deterministic_and_keep_types() -> None:
    repairer = scene(PAIR)
    single = [points.astype(np.float32) for points in poses(PAIR)]
    first, second = repairer(single), repairer(single)
    for one, other in zip(first, second, strict=True):
        assert one.points.dtype == np.float32
        assert np.array_equal(one.points, other.points)


def test_rest_intersections_respect_the_mode() -> None:
    meshes = [(TUBES, TUBE_FACES), placed(0.0, 0.15, 0.3)]
    found = {
        mode: scene(meshes, RepairOptions(mode=mode)).rest_intersections
        for mode in ("self", "inter", "both")
    }
    assert 0 < found["self"] < found["both"] and 0 < found["inter"] < found["both"]
    assert found["self"] == len(np.unique(exact_pairs(TUBES, TUBE_FACES)))


def test_wrong_scenes_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one body"):
        SceneRepairer([])
    repairer = scene(PAIR)
    with pytest.raises(ValueError, match="should hold 2 poses, got 1"):
        repairer([BALL])
    with pytest.raises(ValueError, match="rows"):
        repairer([BALL, BALL[1:]])
    for wrong in (-0.1, 1.5, float("nan")):
        with pytest.raises(ValueError, match="mobility should be between 0 and 1"):
            scene(PAIR, mobility=[1.0, wrong])
    for wrong in (0.0, -99.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="diffusion should be positive and finite"):
            scene(PAIR, diffusion=[None, wrong])
    with pytest.raises(ValueError, match="pin should hold"):
        scene(PAIR, pin=[None, np.ones(2)])


def test_ignored_pairs_are_neither_counted_nor_moved() -> None:
    meshes = [(TUBES, TUBE_FACES), placed(0.0, 0.15, 0.3), placed(0.35, 0.15, 0.3)]

    def repaired(*ignore: tuple[int, int]) -> list[RepairResult]:
        return SceneRepairer([Body(*mesh) for mesh in meshes], ignore=ignore)(poses(meshes))

    every = repaired()
    assert all(result.after.pairs == 0 < result.before.pairs for result in every)
    less = repaired((2, 1), (0, 0))
    owner = np.repeat([0, 1, 2], [len(faces) for _, faces in meshes])
    pairs = owner[exact_pairs(*joined(*meshes))]
    kept = pairs[(pairs[:, 0] == 0) & (pairs[:, 1] > 0)]
    for index, result in enumerate(less):
        assert result.before.pairs == (kept == index).any(axis=1).sum() > 0
        assert result.after.pairs == 0 and result.status is Status.CLEAN
    left = [(result.points, mesh[1]) for result, mesh in zip(less, meshes, strict=True)]
    still = {tuple(pair) for pair in owner[exact_pairs(*joined(*left))].tolist()}
    assert still == {(0, 0), (1, 2)}
    nothing = repaired((0, 0), (0, 1), (0, 2), (1, 2))
    for result, (points, _) in zip(nothing, meshes, strict=True):
        assert np.array_equal(result.points, points) and result.before.pairs == 0


@pytest.mark.parametrize("wrong", [(0, 2), (-1, 0)])
def test_ignored_bodies_must_exist(wrong: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="pairs of bodies 0 to 1"):
        SceneRepairer([Body(*mesh) for mesh in PAIR], ignore=[wrong])
