"""What rests on something in the reference alone is not attached to it; what is held there is."""

from __future__ import annotations

import numpy as np
import pytest

from dtrepair import Body, RepairOptions
from dtrepair.diagnosis import StrainKind
from dtrepair.intersect.detector import Detector
from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.attached.overlaps import find_attachments
from dtrepair.numerics.attachments import Reference
from dtrepair.numerics.geometry import FloatArray, diagonal
from dtrepair.repair.scene.make_scene import make_scene
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMeshes
from dtrepair.repair.strain.bounds import Excess, StrainOptions
from dtrepair.repair.strain.letting_go import LettingGoOptions, ties_that_hold
from dtrepair.repair.strain.meter import StrainMeter
from dtrepair.repair.strain.parts import ConnectedParts
from tests.meshes import joined, tube

NO_PAIRS = np.zeros((0, 2), dtype=np.int32)
# A trunk, and a lock that is rooted in its top and whose tip touches its side further down.
TRUNK, LOCK = tube(14, 24, 0.25, 2.0), tube(10, 40, 0.05, 1.4)


def bent(tip: float) -> FloatArray:
    """The lock from the top of the trunk down to its tip, which lies so far from the side."""
    points = LOCK[0]
    along = points[:, 2] + 0.7  # 0 at the root, 1.4 at the tip
    out = np.interp(along, [0.0, 0.4, 0.9, 1.4], [0.0, 0.35, 0.35, 0.26 + tip])
    up = np.interp(along, [0.0, 0.4, 1.4], [0.95, 0.95, -0.05])
    return np.stack([points[:, 0] + out, points[:, 1], up + 0.0 * along], axis=1)


def lock_on_trunk(*tips: float) -> Scene:
    """The scene of the reference, in which the tip touches, and of a clip with these tips."""
    rest, faces = joined(TRUNK, (bent(0.0), LOCK[1]))
    shown = Reference(rest, Detector(rest, faces)(rest))
    poses = [joined(TRUNK, (bent(tip), LOCK[1]))[0] for tip in tips]
    layers = [Reference(pose, NO_PAIRS) for pose in poses]
    bodies = [Body(*TRUNK), Body(bent(0.0), LOCK[1])]
    return make_scene(bodies, RepairOptions(), references=[shown], layer_poses=layers)


def tied_tips(scene: Scene) -> int:
    """How many vertices of the tip are tied in the mesh that is solved."""
    ties = WeldedMeshes(scene)([scene.weld(scene.rest)]).surface.ties
    assert ties is not None
    first = int(len(TRUNK[0]) + 0.8 * len(LOCK[0]))
    return len(np.unique(ties.links[first:].nonzero()[0]))


def test_what_only_rests_is_not_tied_once_the_clip_leads_it_off() -> None:
    every = tied_tips(lock_on_trunk())
    assert every > 4 and tied_tips(lock_on_trunk(0.0, 0.01, 0.02)) == every
    # Led off in one pose of three it is still held, in two it is not.
    assert tied_tips(lock_on_trunk(0.0, 0.0, 0.5)) == every
    assert tied_tips(lock_on_trunk(0.0, 0.5, 0.4)) == 0
    # A single pose, which may be the rest, is no clip.
    assert tied_tips(lock_on_trunk(0.5)) == every
    scene = lock_on_trunk(0.5, 0.4)
    assert scene.attachments is not None and scene.held is not None
    # Its root holds, and so does what counts as modelled.
    assert 0 < len(scene.held.ties.vertices) < len(scene.attachments.ties.vertices)
    assert np.array_equal(scene.held.zones, scene.attachments.zones)


def test_two_parts_that_no_patch_holds_stay_tied_where_they_meet() -> None:
    scene = lock_on_trunk()
    known = scene.attachments
    assert known is not None
    slid = scene.rest.copy()
    slid[len(TRUNK[0]) :] -= [0.0, 0.0, 0.2]
    met = Reference(slid, scene.detector(slid))
    assert scene.strain_meter.let_go(slid, LettingGoOptions.bound).mean() > 0.9
    assert known.modelled(met.pairs).any()
    assert ties_that_hold(scene.strain_meter, known, [met] * 2).all()
    apart = [met._replace(pairs=NO_PAIRS)] * 2
    assert not ties_that_hold(scene.strain_meter, known, apart).any()


def test_a_patch_goes_as_a_whole() -> None:
    scene = lock_on_trunk(0.5, 0.5)
    meter, known, poses = scene.strain_meter, scene.attachments, scene.layer_poses
    assert known is not None
    gone = meter.let_go(poses[0].points, LettingGoOptions.bound)
    patch = meter.parts.tie_patches
    tips = np.unique(patch[~ties_that_hold(meter, known, poses)])
    assert len(tips) and gone[np.isin(patch, tips)].mean() >= LettingGoOptions.patch
    most = LettingGoOptions(patch=1.01)
    assert ties_that_hold(meter, known, poses, options=most).all()


@pytest.mark.parametrize("references", [1, 2])
def test_patches_are_what_edges_connect_on_one_side_of_a_joint(references: int) -> None:
    """With two references the same vertex is tied twice."""
    rest, faces = joined(TRUNK, (bent(0.0), LOCK[1]))
    shown = Reference(rest, Detector(rest, faces)(rest))
    found = find_attachments(faces, len(rest), [shown] * references)
    parts = ConnectedParts(faces, np.zeros(len(rest), dtype=np.int32), found)
    assert parts.ties is not None
    side = parts.of_vertex[parts.ties.vertices]
    expected = np.empty(len(side), dtype=np.int32)
    for own in np.unique(side):
        tied = np.isin(parts.edges, parts.ties.vertices[side == own]).all(axis=1)
        label = link_labels(parts.edges[tied], parts.vertices)
        expected[side == own] = label[parts.ties.vertices[side == own]]
    patch = parts.tie_patches
    both = np.unique(np.stack([patch, expected]), axis=1)
    assert both.shape[1] == len(np.unique(patch)) == len(np.unique(expected)) == 4


@pytest.mark.parametrize("scale", [1e-3, 1.0, 100.0])
def test_what_the_input_led_off_is_no_joint_but_goes_no_farther(scale: float) -> None:
    """`scale`: of the pose, whose animation enlarges all."""
    known = lock_on_trunk().strain_meter
    # Half of all ties are those of the tip.
    meter = StrainMeter(known.parts, references=known.references, options=StrainOptions(slide=1.0))
    held = StrainMeter(known.parts, options=meter.options)
    before = scale * joined(TRUNK, (bent(0.5), LOCK[1]))[0]
    size = diagonal(before)
    share = np.linspace(0.0, 1.0, len(LOCK[0])) > 0.8
    drift, slide = [StrainKind.DRIFT], [StrainKind.SLIDE]
    for away, loose, tight, tied in (
        (0.015, [], [], slide),
        (0.025, [], drift, drift),
        (0.045, drift, drift, drift),
    ):
        after = before.copy()
        after[len(TRUNK[0]) :][share] += [away * size, 0.0, 0.0]
        assert _loosened(meter(before, after, loosely=True)) == loose
        assert _loosened(meter(before, after)) == tight
        assert _loosened(meter(before, after, strict=True)) == tight
        assert _loosened(held(before, after)) == tied
        # One joint may slide as far as a vertex may drift.
        assert _loosened(held(before, after, loosely=True)) == tight
        every = slide if tied == slide else drift + slide
        assert _loosened(held(before, after, strict=True)) == every


def test_what_goes_back_to_where_it_was_modelled_may_not_leap_there() -> None:
    known = lock_on_trunk().strain_meter
    rest, off = (joined(TRUNK, (bent(turn), LOCK[1]))[0] for turn in (0.0, 0.5))
    way = (off - rest) / np.linalg.norm(off - rest, axis=1).max()
    far = np.linalg.norm(way, axis=1) > 0.75
    for away, told in ((0.015, []), (0.025, [StrainKind.DRIFT])):
        before = rest + away * diagonal(rest) * far[:, None] * way
        assert _loosened(known(before, rest)) == told
        assert _loosened(known(before, rest, loosely=True)) == []
        # As far the other way it has come off.
        assert _loosened(known(before, 2.0 * before - rest))


def test_what_the_input_left_in_its_place_slides_also_towards_where_it_was_modelled() -> None:
    known = lock_on_trunk().strain_meter
    rest, off = (joined(TRUNK, (bent(turn), LOCK[1]))[0] for turn in (0.0, 0.5))
    way = (off - rest) / np.linalg.norm(off - rest, axis=1).max()
    before = rest + 0.009 * diagonal(rest) * way
    assert not known.let_go(before, known.options.joint).any()
    assert _loosened(known(before, rest)) == [StrainKind.SLIDE]
    assert _loosened(known(before, rest, loosely=True)) == []


def test_relief_aims_at_a_little_less_than_may_be() -> None:
    scene = lock_on_trunk()
    meter, before = scene.strain_meter, scene.rest
    assert 0.0033 < StrainOptions.aim * StrainOptions.slide < 0.0037 < StrainOptions.slide
    for away, strict in ((0.0033, []), (0.0037, [StrainKind.SLIDE])):
        after = before.copy()
        after[len(TRUNK[0]) :] += [away * diagonal(before), 0.0, 0.0]
        assert not meter(before, after)
        assert _loosened(meter(before, after, strict=True)) == strict


def test_what_came_off_is_named_not_what_the_input_let_go() -> None:
    """The tip, which the input led off, may go farther than a root that it holds may slide."""
    known = lock_on_trunk().strain_meter
    before = joined(TRUNK, (bent(0.5), LOCK[1]))[0]
    along = np.linspace(0.0, 1.0, len(LOCK[0]))
    root, size = along < 0.3, diagonal(before)
    after = before.copy()
    own = after[len(TRUNK[0]) :]
    own[along > 0.8] += [0.015 * size, 0.0, 0.0]
    own[root] += [0.0, 0.0, 0.025 * size]
    (found,) = [own for own in known(before, after) if own.kind is StrainKind.DRIFT]
    tips = len(TRUNK[0]) + np.flatnonzero(along > 0.8)
    assert found.bound == StrainOptions.drift < found.value < 0.035
    assert found.worst not in tips and not np.isin(found.vertices, tips).any()


def _loosened(found: list[Excess]) -> list[StrainKind]:
    return [own.kind for own in found if own.kind in (StrainKind.DRIFT, StrainKind.SLIDE)]
