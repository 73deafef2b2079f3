"""Props bend where something met one in a frame in which anything is wrong; else nobody asks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.repair.relief.props import with_props
from dtrepair.repair.scene.bounds import Judged
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.opened_pose import OpenedPose, detected, gathered
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from tests.meshes import icosphere

BALL, FACES = icosphere(1)
ALONG = np.array([1.0, 0.0, 0.0])
FAR = 20.0 * ALONG
SCENE = make_scene(
    [Body(BALL, FACES), Body(BALL + 5.0 * ALONG, FACES), Body(BALL + FAR, FACES, prop=True)],
    RepairOptions(),
)
# Where the second ball is, and the prop.
CLEAN, MET, PROP = (5.0, 20.0), (1.0, 20.0), (5.0, 1.0)


def frame(ball: float, prop: float) -> OpenedPose:
    return detected(SCENE, gathered(SCENE, [BALL, BALL + ball * ALONG, BALL + prop * ALONG]))


@pytest.mark.parametrize(
    ("places", "asked"),
    [
        ((CLEAN, CLEAN), 1),
        ((MET, CLEAN), 1),
        ((PROP, CLEAN), 2),
        ((MET, PROP), 2),
    ],
)
def test_bending_is_tried_where_it_may_help(
    places: Sequence[tuple[float, float]], asked: int
) -> None:
    frames, calls = [frame(*place) for place in places], list[bool]()

    def judge(meshes: WeldedMeshes, own: list[OpenedPose]) -> list[Judged]:
        calls.append(meshes.scene.bodies[2].rigid)
        return [Judged(pose.centred) for pose in own]

    judged, taken = with_props(WeldedMeshes(SCENE), frames, judge)
    assert calls == [True, False][:asked] and taken.scene.bodies[2].rigid
    assert len(judged) == len(frames)
