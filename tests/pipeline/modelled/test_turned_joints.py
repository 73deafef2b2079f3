"""Limbs that turn about balls: where they turn to counts; it is left alone or called attached."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dtrepair.pipeline import check_stage, repair_stage
from dtrepair.pipeline.modelled.references import modelled_references
from dtrepair.pipeline.selection import Selection
from dtrepair.pipeline.stages.rest import Rest
from dtrepair.pipeline.stages.sources import open_source
from dtrepair.repair.clip import window_repairer
from tests.meshes import icosphere, joined, swept
from usd_io import AuthoredMesh, write_animation

BALL = icosphere(3, 0.5)
# A limb along z that ends in the ball, and meets it in one ring.
CENTRES = np.linspace(0.2, 2.0, 19)[:, None] * [0.0, 0.0, 1.0]
LIMB = swept(CENTRES, np.full(19, 0.25), 12, closed=False)
ATTACHED = ("/Root/Joint,/Root/Joint",)


def joint(path: Path, degrees: float, *, drift: float = 0.0, wide: float = 1.0) -> Path:
    """A stage of a limb that turns about the ball by so much within nine frames.

    drift: how far the centre goes meanwhile; wide: factor of the limb's width at the end.
    """
    poses = []
    for share in np.linspace(0.0, 1.0, 9):
        turn = Rotation.from_rotvec((np.radians(degrees) * share, 0.0, 0.0))
        width = 1.0 + share * (wide - 1.0)
        limb = np.asarray(turn.apply(LIMB[0] * np.array([width, width, 1.0])))
        limb[:, 0] += drift * share
        poses.append(joined(BALL, (limb, LIMB[1]))[0])
    faces = joined(BALL, LIMB)[1]
    whole = Rotation.from_rotvec((0.0, 0.4, 0.0))
    placed = [
        (whole**k).apply(pose) for k, pose in zip(np.linspace(0.0, 1.0, 9), poses, strict=True)
    ]
    drawn = AuthoredMesh(path="/Root/Joint", faces=faces, points=placed, rest=poses[0])
    write_animation(path, drawn, times=1.0 + np.arange(9.0))
    return path


def pairs(path: Path, attach: tuple[str, ...] = ()) -> list[int]:
    """The pairs of each frame that are not modelled."""
    counts = [frame.before for frame in check_stage(path, attach=attach).frames]
    return [count.pairs for count in counts if count is not None]


def test_where_a_limb_turned_to_counts_unless_it_is_called_attached(tmp_path: Path) -> None:
    path = joint(tmp_path / "a.usda", 130.0)
    counted = pairs(path)
    assert counted[0] == 0 and counted[-1] > 20
    assert pairs(path, attach=ATTACHED) == [0] * 9


@pytest.mark.parametrize(
    ("degrees", "options"),
    # Not far enough; its centre wanders; it swells.
    [(50.0, {}), (130.0, {"drift": 0.4}), (130.0, {"wide": 1.5})],
)
def test_what_does_not_turn_far_about_a_centre_is_not_called_so(
    degrees: float, options: dict[str, float], tmp_path: Path
) -> None:
    path = joint(tmp_path / "a.usda", degrees, **options)
    assert pairs(path, attach=ATTACHED) == pairs(path)


def test_only_what_turns_is_looked_for(tmp_path: Path) -> None:
    for degrees, turns in ((10.0, False), (130.0, True)):
        source = open_source(str(joint(tmp_path / f"{degrees}.usda", degrees)), Selection())
        found = modelled_references(source, [Rest(mesh.rest, "") for mesh in source.meshes])
        assert any(reference.turned for reference in found) == turns


def test_a_strained_joint_that_turned_is_left_alone_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, last = joint(tmp_path / "a.usda", 135.0), Selection(frames="8:9")
    frames = repair_stage(path, tmp_path / "b.usda", selection=last).frames
    # One of them may come clean by luck.
    left = [frame for frame in frames if frame.status == "strained"]
    assert left
    for frame in left:
        assert frame.before is not None and frame.after is not None
        assert frame.after.pairs == frame.before.pairs > 20 and not frame.displacement_max
        assert frame.left.strains
        assert "--attach" in frame.message and "--at-any-cost" in frame.message
    # Else the joint gives way.
    monkeypatch.setattr(
        window_repairer, "with_turns", lambda meshes, frames, judged, *_, options: judged
    )
    frames = repair_stage(path, tmp_path / "c.usda", selection=last).frames
    times = [frame.time for frame in left]
    assert any(frame.displacement_max > 0.01 for frame in frames if frame.time in times)
