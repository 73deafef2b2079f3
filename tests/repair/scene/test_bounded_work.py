"""What attached parts take ends: relaxing after so much work, mending where it would be in vain."""

from __future__ import annotations

import pytest

from dtrepair.numerics.work import work_done
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.mending import mended
from tests.repair.scene.test_relief import pairs_of, winged


@pytest.mark.parametrize("attached", [True, False])
def test_relaxing_of_attached_parts_ends_with_their_work(attached: bool) -> None:
    _, frame, mesh = winged(1.6, attached=attached)
    pose, cycles = mesh.reduced(frame.centred), []
    for times in (0.0, FullOptions.relax_attached):
        options = FullOptions(relax_attached=times)
        stages = FullMethod(mesh.surface, options=options)(pose).stages
        cycles += [stage.iterations for stage in stages if stage.name == "relax"]
    assert len(cycles) == 2 and cycles[1] > 0
    assert cycles[0] == (0 if attached else cycles[1])


@pytest.mark.parametrize("lowered", [True, False])
def test_a_share_that_left_many_pairs_is_not_mended(lowered: bool) -> None:
    scene, frame, mesh = winged(1.6)
    judged = Judged(frame.centred, lowered=lowered)

    def work(share_pairs: int) -> float:
        start = work_done()
        own, left = mended(
            scene,
            mesh,
            frame.centred,
            judged,
            frame.pairs,
            lambda points: pairs_of(scene, frame, points),
            step=0.002,
            options=MendOptions(share_pairs=share_pairs),
        )
        assert len(left) < len(frame.pairs) or own is judged
        return work_done() - start

    assert work(len(frame.pairs)) > 0.0
    assert (work(len(frame.pairs) - 1) == 0.0) == lowered
