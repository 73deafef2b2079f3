"""What is told of corrections between keys: an added key that throws something out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from dtrepair.keyposes.spans import KeyPoses, Span
from dtrepair.pipeline.keyposes import stage
from dtrepair.pipeline.keyposes.solve import StageKeys
from dtrepair.pipeline.keyposes.stage import repair_keyposes
from dtrepair.report.findings import FindingKind, MotionFinding
from tests.meshes import elbow, icosphere
from tests.swinging_arm import arm_stage
from usd_io import AuthoredMesh, write_animation

KEYS = (1.0, 11.0)


def jumps(
    path: Path, monkeypatch: pytest.MonkeyPatch, added: dict[float, float]
) -> list[MotionFinding]:
    """Return the jumps that are told where keys of the last mesh are moved so far, by time."""

    def search(prepared: object, keys: StageKeys, observer: object) -> KeyPoses:
        *others, given = keys.tracks
        track = given
        for time, far in added.items():
            pose = given.at(time) + np.array([far, 0.0, 0.0], np.float32)
            track = track.with_key(time, pose)
        return KeyPoses((*others, track), (Span(*KEYS, (), (), tuple(added)),))

    monkeypatch.setattr(stage, "_search", search)
    found = repair_keyposes(path, path.with_name("out.usdc")).findings
    return [own for own in found if own.kind is FindingKind.JUMPS]


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """An arm between two keys, ten frames apart; 2.2 from end to end."""
    return arm_stage(tmp_path / "arm.usda", (1.0, 0.9), times=KEYS)


def test_an_added_key_that_throws_something_out_is_told(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (found,) = jumps(arm, monkeypatch, {5.0: 0.0, 6.0: 0.3, 7.0: 0.0})
    assert found.path == "/Root/Arm" and found.times == (6.0,)
    assert 0.1 < found.largest < 0.2


@pytest.mark.parametrize(
    "added",
    [{6.0: 0.2}, {5.0: 0.0, 6.0: 0.035, 7.0: 0.0}, {4.0: 0.0, 5.0: 0.1, 6.0: 0.2}, {}],
    ids=["slow", "little", "for good", "none"],
)
def test_what_goes_over_from_key_to_key_is_not(
    arm: Path, monkeypatch: pytest.MonkeyPatch, added: dict[float, float]
) -> None:
    assert jumps(arm, monkeypatch, added) == []


def test_a_jump_counts_in_the_size_of_all_that_moves(
    arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody sees a button jump by its own radius."""
    ball, faces = icosphere(1, 0.1)
    stage = Usd.Stage.Open(str(arm))
    mesh = UsdGeom.Mesh.Define(stage, "/Root/Ball")
    mesh.GetFaceVertexCountsAttr().Set([3] * len(faces))
    mesh.GetFaceVertexIndicesAttr().Set(faces.ravel().tolist())
    for time in KEYS:
        mesh.GetPointsAttr().Set((ball + np.array([5.0, 0.0, 0.0])).astype(np.float32), time)
    stage.Save()
    thrown = {5.0: 0.0, 6.0: 0.03, 7.0: 0.0}
    assert jumps(arm, monkeypatch, thrown) == []
    (found,) = jumps(arm, monkeypatch, {time: 2.0 * far for time, far in thrown.items()})
    assert found.path == "/Root/Ball" and found.largest > 0.1


def test_what_moves_with_its_parent_does_not_stand_still(tmp_path: Path) -> None:
    """A ball with the same points in all keys, at an arm that moves on."""
    (arm, quads), (ball, faces) = elbow(0.1), icosphere(2, 0.1)
    side = arm[np.abs(arm[:, 2] - 0.6) < 0.1, 0].max()
    for along, told in ((0.0, True), (1.0, False)):
        path = tmp_path / f"{along}.usda"
        shifts = np.repeat(np.eye(4)[None], 2, axis=0)
        shifts[:, 3, :3] = [[side + 0.05, along * k, 0.6] for k in range(2)]
        moved = [arm + np.array([0.0, (along + 0.01) * k, 0.0]) for k in range(2)]
        meshes = [
            AuthoredMesh("/Root/Arm", quads, moved, rest=arm),
            AuthoredMesh("/Root/Ball/Ball", faces, rest=ball, transforms=shifts),
        ]
        write_animation(path, meshes, times=[1.0, 5.0])
        found = repair_keyposes(path, path.with_name("out.usdc")).findings
        kinds = {own.kind for own in found if own.path == "/Root/Ball/Ball"}
        assert (FindingKind.MOVED in kinds) == told
