"""Limbs that lie in each other: which way out is short, and that all of them go it at once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtrepair.numerics.geometry import FloatArray, lengths, unit_vectors
from dtrepair.numerics.work import work_done
from dtrepair.repair.elastic.sections import (
    SectionOptions,
    _displacement,
    _Meeting,
    _meetings,
    overlaps_along,
    sections_apart,
)
from dtrepair.repair.full import phases as phases_module
from dtrepair.repair.full.biharmonic_fill import Candidate
from dtrepair.repair.full.phases import PhaseOptions, Phases
from dtrepair.repair.full.push import PushOptions
from dtrepair.repair.surface.defects import Defects
from dtrepair.repair.surface.surface import BodyRange, Surface
from tests.meshes import Mesh, crossed_legs, crossing_tubes, elbow, joined

# For tubes that are thick next to their lengths.
LONG = SectionOptions(step=0.06)


def tilted(mesh: Mesh, angle: float, ahead: float) -> Mesh:
    """Swing a mesh about the first axis, and move it along the second one."""
    (points, faces), (cos, sin) = mesh, (np.cos(angle), np.sin(angle))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
    return points @ turn.T + [0.0, ahead, 0.0], faces


def beast(across: float, forward: float) -> Mesh:
    """Four legs, of which those of either pair cross, and the pairs swing into each other."""
    pair = crossed_legs(across, 0.0, along=36, around=10)
    return joined(tilted(pair, forward, -0.4), tilted(pair, -forward, 0.4))


def _meetings_at_rest(surface: Surface, options: SectionOptions) -> list[_Meeting]:
    pairs = surface.contacts.pairs(surface.rest)
    return _meetings(surface, surface.rest, pairs, pairs, options)


def posed(rest: Mesh, pose: Mesh) -> tuple[Surface, FloatArray]:
    surface = Surface(*rest)
    return surface, pose[0] / surface.size


@given(st.integers(0, 2**32 - 1))
def test_what_went_its_overlap_has_passed(seed: int) -> None:
    random = np.random.default_rng(seed)
    first, second = random.normal(size=(30, 3)), random.normal(0.3, size=(20, 3))
    ways = unit_vectors(random.normal(size=(8, 3)))
    for way, length in zip(ways, overlaps_along(first, second, ways, 0.7), strict=True):
        if not np.isfinite(length):
            continue
        (left,) = overlaps_along(first + length * way, second, way[None], 0.7)
        (more,) = overlaps_along(first + (length - 0.25) * way, second, way[None], 0.7)
        assert left == pytest.approx(0.0, abs=1e-9) and more == pytest.approx(0.25)


def test_points_only_pass_those_in_their_column() -> None:
    low, high = np.array([[0.5, 0.5, -1.0]]), np.array([[0.5, 0.5, 2.0], [9.5, 0.5, 7.0]])
    up = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    overlaps = overlaps_along(low, high, up, 1.0)
    assert overlaps[0] == pytest.approx(3.0) and overlaps[1] == pytest.approx(-3.0)
    assert np.isinf(overlaps[2])  # nothing is beside it at its height


def test_legs_that_cross_go_to_their_own_sides_by_what_overlaps() -> None:
    surface, pose = posed(crossed_legs(0.0, 0.0), crossed_legs(0.45, 0.02))
    before = len(surface.contacts.pairs(pose))
    apart = sections_apart(surface, pose)
    assert apart is not None
    assert len(surface.contacts.pairs(apart)) <= 0.5 * before
    moved = (apart - pose) * surface.size
    # The legs, of radius 0.12, stand 0.04 apart in depth: either has some 0.1 to go there.
    below = surface.rest[:, 2] * surface.size < -0.6
    right, left = (below & (sign * surface.rest[:, 0] > 0.0) for sign in (1.0, -1.0))
    assert moved[left, 1].max() > 0.05 and moved[right, 1].min() < -0.05
    assert moved[left, 1].min() > -0.02 and moved[right, 1].max() < 0.02
    assert lengths(moved).max() < 0.3


def test_a_crease_and_two_bodies_have_no_sections() -> None:
    surface, pose = posed(elbow(0.0), elbow(2.8))
    assert len(surface.contacts.pairs(pose)) and sections_apart(surface, pose) is None
    points, faces = crossing_tubes(24, 32, 0.0)
    half = len(points) // 2
    free = [BodyRange(0, half, 99.0), BodyRange(half, len(points), 99.0)]
    bodies = Surface(points, faces, bodies=free)
    assert len(bodies.contacts.pairs(bodies.rest))
    assert sections_apart(bodies, bodies.rest, options=LONG) is None
    one = Surface(points, faces)
    assert sections_apart(one, one.rest, options=LONG) is not None


def test_what_may_not_move_stays_and_the_other_one_goes() -> None:
    points, faces = crossing_tubes(24, 32, 0.0)
    still = np.arange(len(points)) < len(points) // 2
    surface = Surface(points, faces, mobility=np.where(still, 0.0, 1.0))
    apart = sections_apart(surface, surface.rest, options=LONG)
    assert apart is not None
    assert (apart[still] == surface.rest[still]).all()
    assert lengths(apart - surface.rest)[~still].max() > 0.01


@pytest.mark.parametrize(("across", "forward"), [(0.4, 0.18), (0.35, 0.2)])
def test_four_legs_in_each_other_are_bent_less(across: float, forward: float) -> None:
    surface, pose = posed(beast(0.0, 0.0), beast(across, forward))
    old, new = (
        Phases(surface, pose, tightened=False, skip=skip).best() for skip in (("sections",), ())
    )
    assert new.clean and not surface.contacts.pairs(new.points).size
    assert new.distortion < 0.85 * old.distortion


def test_the_means_of_two_sections_come_apart_by_their_way() -> None:
    points, faces = crossing_tubes(24, 32, 0.0)
    surface, options = Surface(points, faces), SectionOptions(soft=0.0)
    (one,) = _meetings_at_rest(surface, options)
    moved = _displacement(surface, [one], options)
    first, second = (
        np.average(moved[own], axis=0, weights=surface.mass[own]) for own in (one.first, one.second)
    )
    assert one.length > options.step
    assert (first - second) @ one.way == pytest.approx(options.step, rel=1e-6)
    # The other way round it is asked for what it does already: nothing moves on.
    passed = one._replace(length=-1.0)
    assert lengths(_displacement(surface, [passed], options)).max() == 0.0


def test_what_hardly_moves_in_contact_is_not_thrown() -> None:
    points, faces = crossing_tubes(24, 32, 0.0)
    near = lengths(points) < 0.5
    surface = Surface(points, faces, mobility=np.where(near, 1e-3, 1.0))
    farthest = {}
    for most in (0.1, np.inf):
        options = SectionOptions(rounds=1, left=np.inf, farthest=most)
        meetings = _meetings_at_rest(surface, options)
        farthest[most] = lengths(_displacement(surface, meetings, options)).max()
    assert farthest[np.inf] > 0.2 and farthest[0.1] == pytest.approx(0.1)


def test_an_attempt_that_leads_nowhere_takes_no_work() -> None:
    surface, pose = posed(beast(0.0, 0.0), beast(0.4, 0.18))
    for options, farthest in ((SectionOptions(left=0.0), None), (SectionOptions(), 0.01)):
        phases = Phases(surface, pose, farthest=farthest, options=PhaseOptions(sections=options))
        room, before = phases.enough() - work_done(), work_done()
        assert phases._sections_apart() is None
        assert work_done() > before
        assert phases.enough() - work_done() == pytest.approx(room)


def test_of_large_sections_some_points_are_looked_at_and_few_meet() -> None:
    surface, pose = posed(beast(0.0, 0.0), beast(0.4, 0.18))
    pairs = surface.contacts.pairs(pose)
    every = _meetings(surface, pose, pairs, pairs, SectionOptions())
    (one,) = _meetings(surface, pose, pairs, pairs, SectionOptions(numbers=1))
    assert len(every) > 1 and any(np.array_equal(one.first, each.first) for each in every)
    fewer = _meetings(surface, pose, pairs, pairs, SectionOptions(points=40, columns=4))
    assert len(fewer) == len(every)
    assert [each.length for each in fewer] != [each.length for each in every]


def test_what_leaves_no_less_changes_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    surface, pose = posed(beast(0.0, 0.0), beast(0.4, 0.18))
    phases = Phases(surface, pose, tightened=False)
    room = phases.enough() - work_done()
    assert phases._sections_apart() is not None
    assert phases.candidates == [] and phases.enough() - work_done() == pytest.approx(room)
    without = Phases(surface, pose, tightened=False, skip=("sections",)).best()
    # A way that leads into a heap, of which no push makes a clean pose.
    heap = np.random.default_rng(0).normal(size=pose.shape)
    monkeypatch.setattr(phases_module, "sections_apart", lambda *_, **__: heap)
    found = Phases(surface, pose, tightened=False).best()
    assert (found.points == without.points).all()


@pytest.mark.parametrize("few", [False, True])
@pytest.mark.parametrize("far_less", [0.0, 0.65])
def test_what_far_less_is_left_of_is_insisted_on(
    far_less: float, few: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At once where it concerns few of the bodies, else after all steps."""
    surface, pose = posed(beast(0.0, 0.0), beast(0.4, 0.18))
    options = PhaseOptions(push=PushOptions(iterations=1), far_less=far_less)
    phases = Phases(surface, pose, tightened=False, options=options, skip=("fill",))
    pushed, apart = phases.run(options.first_steps[0]), phases._sections_apart()
    assert apart is not None and 0 < apart.rank[0] <= 0.65 * pushed.rank[0]
    phases.candidates.clear()
    calls = list[tuple[int, set[int]]]()
    nothing = phases.known.crossings[:0]
    cleaned = apart._replace(defects=Defects(nothing, nothing), distortion=0.0)

    def insist(best: Candidate) -> Candidate:
        calls.append((best.rank[0], {candidate.rank[0] for candidate in phases.candidates}))
        return cleaned

    monkeypatch.setattr(phases, "insist", insist)
    monkeypatch.setattr(phases, "_concerns_few", lambda best: few)
    assert phases.best() is cleaned
    ((chosen, kept),) = calls
    if far_less:
        assert chosen == apart.rank[0] in kept and pushed.rank[0] not in kept
    else:
        assert chosen > apart.rank[0] and chosen in kept and apart.rank[0] not in kept


def test_with_a_limit_nothing_goes_beyond_it() -> None:
    surface, pose = posed(beast(0.0, 0.0), beast(0.4, 0.18))
    push = PushOptions(iterations=1)
    phases = Phases(surface, pose, farthest=0.01, options=PhaseOptions(push=push))
    assert phases._sections_apart() is None
    assert lengths(phases.best().points - pose).max() <= 0.01 + 1e-9
