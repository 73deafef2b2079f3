"""The search for a clean pose ends after so much work, and always with the best that it has."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dtrepair.repair.full.biharmonic_fill import Candidate
from dtrepair.repair.full.phases import PhaseOptions, Phases
from dtrepair.repair.full.push import PushOptions
from dtrepair.repair.options import OptionError, RepairOptions
from dtrepair.repair.repairer import Repairer
from dtrepair.repair.surface.surface import Surface
from tests.meshes import armed_body, crossing_tubes

# A hard pose: tubes deep in each other, of which the first step leaves something.
HARD = PhaseOptions(near=(20, 12), insist_steps=(0.005, 0.002))


def attempts(effort: float) -> tuple[int, int]:
    """How many poses the search has made, and how many crossings its best one has."""
    points, faces = crossing_tubes(24, 32, 0.0)
    surface = Surface(points, faces)
    phases = Phases(surface, points / surface.size, effort=effort, options=HARD)
    best = phases.best()
    return len(phases.candidates), len(best.defects.crossings)


def test_less_effort_makes_fewer_attempts_and_ends_with_the_best() -> None:
    few, left_of_few = attempts(1e-9)
    many, left_of_many = attempts(1.0)
    assert few == 1 and many > few
    assert left_of_many <= left_of_few


def test_effort_changes_nothing_where_it_suffices() -> None:
    points, faces = armed_body(0.0)
    posed, _ = armed_body(1.2)
    one, ten = (
        Repairer(points, faces, options=RepairOptions(effort=effort))(posed)
        for effort in (1.0, 10.0)
    )
    assert (one.points == ten.points).all()


def test_insisting_ends_between_its_rounds() -> None:
    points, faces = crossing_tubes(24, 32, 0.0)
    surface = Surface(points, faces)
    phases = Phases(surface, points / surface.size, effort=1e-9, options=HARD)
    given = Candidate(phases.original, phases.known, 0.0, 0)
    assert phases.worked_enough
    assert phases._alternated(given, 0.01) is given


def test_what_a_push_left_as_it_was_is_not_filled_again() -> None:
    # A step as long as the mesh only makes things worse, so that both phases end where they began.
    points, faces = crossing_tubes(24, 32, 0.0)
    surface = Surface(points, faces)
    options = replace(HARD, near=(0, 0), push=PushOptions(patience=1, part=float("inf")))
    phases = Phases(surface, points / surface.size, options=options)
    best = phases.run(1.0)
    assert [stage.name for stage in phases.log.stages] == ["push 0", "fill", "push 0"]
    assert phases.candidates == [best] and not best.clean


def test_insisting_fills_what_its_steps_leave_as_it_was_once() -> None:
    points, faces = crossing_tubes(24, 32, 0.0)
    surface = Surface(points, faces)
    options = replace(
        HARD,
        near=(0,),
        insist_steps=(1.0, 2.0, 3.0),
        push=PushOptions(patience=1, part=float("inf")),
        last_fill=HARD.fill,
    )
    phases = Phases(surface, points / surface.size, options=options, effort=1e3)
    phases.insist(phases.run(1.0))
    filled = [stage for stage in phases.log.stages if stage.name == "fill"]
    assert len(phases.candidates) == len(filled) < len(phases.log.stages) - len(filled)


@pytest.mark.parametrize("effort", [0.0, -1.0, float("inf"), float("nan")])
def test_effort_is_positive_and_finite(effort: float) -> None:
    with pytest.raises(OptionError, match="effort"):
        RepairOptions(effort=effort)
