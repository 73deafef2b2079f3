"""What attached parts take ends: relaxing after so much work, mending where it would be in vain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.metrics import distortion
from dtrepair.numerics.work import work_done
from dtrepair.repair.elastic.parting import PartingOptions
from dtrepair.repair.full.biharmonic_fill import FillOptions
from dtrepair.repair.full.mend import MendOptions, mend
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.full.phases import PhaseOptions
from dtrepair.repair.full.push import PushOptions
from dtrepair.repair.scene import mending
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.mending import mended
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.strain.bounds import Excess
from tests.repair.relief.test_relief import pairs_of, winged


@pytest.mark.parametrize("attached", [True, False])
def test_relaxing_of_attached_parts_ends_with_their_work(attached: bool) -> None:
    _, frame, mesh = winged(1.6, attached=attached)
    pose, cycles = mesh.reduced(frame.centred), []
    usual = FullOptions()
    for times, always in ((0.0, 0.0), (usual.relax_attached, usual.relax_always)):
        options = FullOptions(relax_attached=times, relax_always=always)
        stages = FullMethod(mesh.surface, options=options)(pose).stages
        cycles += [stage.iterations for stage in stages if stage.name == "relax"]
    assert len(cycles) == 2 and cycles[1] > 0
    assert cycles[0] == (0 if attached else cycles[1])


def test_some_relaxing_is_left_whatever_the_phases_took() -> None:
    _, frame, mesh = winged(1.6)
    options = FullOptions(relax_attached=0.0)
    stages = FullMethod(mesh.surface, options=options)(mesh.reduced(frame.centred)).stages
    assert [stage.iterations > 0 for stage in stages if stage.name == "relax"] == [True]


@pytest.mark.parametrize("attached", [True, False])
def test_attached_parts_that_keep_few_pairs_are_relaxed_as_well(attached: bool) -> None:
    _, frame, mesh = winged(1.6, attached=attached)
    pose, contacts = mesh.reduced(frame.centred), mesh.surface.contacts
    # A short push leaves a few pairs.
    short, never = PushOptions(iterations=6 if attached else 4), PartingOptions(most=0)
    phases = PhaseOptions(near=(0,), push=short, parting=never)
    found = []
    for most, share in ((0, 1.0), (100, 0.0), (100, 1.0)):
        options = FullOptions(left_attached=most, left_share=share, phases=phases)
        found.append(FullMethod(mesh.surface, skip=("fill", "insist"), options=options)(pose))
    left = [len(contacts.pairs(solved.points)) for solved in found]
    assert 0 < left[0] == left[1] <= 100 and left[2] <= left[0]
    relaxed = ["relax" in [stage.name for stage in solved.stages] for solved in found]
    assert relaxed == [False, False, attached]
    values = [distortion(pose, solved.points, mesh.surface.edges) for solved in found]
    assert values[2] < values[0] if attached else values[2] == values[0]


@pytest.mark.parametrize(
    ("lowered", "solved_alone"), [(True, False), (False, False), (False, True)]
)
def test_many_pairs_are_mended_only_by_solving_alone(lowered: bool, solved_alone: bool) -> None:
    scene, frame, mesh = winged(1.6)
    judged = Judged(frame.centred, lowered=lowered)

    def work(mendable: int) -> float:
        start = work_done()
        own, left = mended(
            scene,
            mesh,
            frame.centred,
            judged,
            frame.pairs,
            lambda points: pairs_of(scene, frame, points),
            step=0.002,
            alone=(lambda _, pose: pose) if solved_alone else None,
            options=MendOptions(mendable=mendable),
        )
        assert len(left) < len(frame.pairs) or own is judged
        return work_done() - start

    assert work(len(frame.pairs)) > 0.0
    assert (work(len(frame.pairs) - 1) > 0.0) == solved_alone


@pytest.mark.parametrize(("before", "after"), [(False, False), (False, True), (True, True)])
def test_mending_does_not_strain_what_is_not(
    before: bool, after: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """before, after: whether the pose is strained, and the mended one."""
    scene, frame, mesh = winged(1.6)
    solved = mesh.solve([frame.centred])[0][0]
    judged = Judged(frame.centred + 0.9 * (solved - frame.centred))
    left = pairs_of(scene, frame, judged.points)
    excess = Excess(StrainKind.EDGES, 0, 6.0, 5.0, 0, np.zeros(1, dtype=np.int32))

    def strained(
        _scene: Scene, _before: FloatArray, points: FloatArray, *, loosely: bool
    ) -> tuple[Excess, ...]:
        assert loosely  # what looser bounds held is not strained
        return (excess,) * (before if points is judged.points else after)

    monkeypatch.setattr(mending, "strain_of", strained)
    own, found = mended(
        scene,
        mesh,
        frame.centred,
        judged,
        left,
        lambda points: pairs_of(scene, frame, points),
        step=0.002,
        options=MendOptions(),
    )
    assert len(left) > 0
    if after and not before:
        assert own is judged and found is left
    else:
        assert len(found) < len(left)


@pytest.mark.parametrize("most", [None, 0, 100])
def test_no_turn_of_mending_follows_a_hopeless_one(most: int | None) -> None:
    """One pose that may have as many pairs, one that may have none, and what nobody asked of."""
    _, frame, mesh = winged(1.6)
    pose, still = mesh.reduced(frame.centred), PushOptions(iterations=0)
    never = PartingOptions(most=0)
    options = MendOptions(push=still, fill=FillOptions(rounds=0), parting=never, few=0)

    def work(most: int | None, options: MendOptions) -> float:
        start = work_done()
        assert mend(mesh.surface, pose, [pose], step=0.0, most=most, options=options) is pose
        return work_done() - start

    one = work(None, replace(options, near=(12,)))
    # Where turns start from one pose, its pairs are found once.
    assert work(most, options) == (1 if most == 0 else 2) * one > 0.0
