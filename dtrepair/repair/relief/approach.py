"""What no push frees is led to its pose from the rest, where nothing has gone through anything yet.

A hand that is behind the back in the rest, and in a pose has gone through the hip, has no way out
that could be seen in that pose. On the way from the rest it meets the hip from its own side, stays
there, and the correction is carried on to the pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from dtrepair.numerics.geometry import FloatArray, IntArray, lengths
from dtrepair.numerics.work import work_done
from dtrepair.repair.elastic.poses_between import BetweenOptions, PosesBetween
from dtrepair.repair.frame.lending import LendingOptions, carried, solved_from
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.scene.bounds import Judged, PairsOf, bounded_pose, rank_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
from dtrepair.repair.strain.shares import ShareOptions
from dtrepair.repair.surface.defects import contact_scale
from dtrepair.repair.surface.surface import Surface


@dataclass(frozen=True, kw_only=True)
class ApproachOptions:
    """How a pose is approached from the rest.

    Args:
        step, least_step: Share of the way that is gone at once, halved down to the second where the
            pose there does not come clean, or costs more than `lending.rough` (see `cost`).
        near: A pose that is nowhere farther than this from the rest, units of the size, led to it
            as a whole, is the rest: there is no way to go.
        work, work_a_triangle: No step begins after so much of it, plus this for each triangle,
            times the effort (units of `numerics.work`).
        gain: What is led in has to leave at most this share of what is wrong with the usual result:
            it goes far, and the usual one tells what strains it.
        between: Numbers of the poses on the way.
        lending: What cleans one of them from what the one before was corrected by.
        share: How the share of a correction is found that is within the bounds.
    """

    step: float = 0.25
    least_step: float = 1 / 16
    near: float = 1e-3
    work: float = 5.5e6
    work_a_triangle: float = 60.0
    gain: float = 0.5
    between: BetweenOptions = field(default_factory=BetweenOptions)
    lending: LendingOptions = field(default_factory=LendingOptions)
    share: ShareOptions = field(default_factory=ShareOptions)


def bounded_approach(
    scene: Scene,
    mesh: WeldedMesh,
    pose: OpenedPose,
    found: tuple[Judged, IntArray],
    pairs_of: PairsOf,
    *,
    options: ApproachOptions = ApproachOptions(),
) -> tuple[Judged, IntArray]:
    """Return what is kept of a pose, with its pairs; if that is no repair, of one led in from rest.

    The better of the two: with much less that is wrong, or less strained if none is. Of what holds
    together as one: free bodies have no common rest. Not with a limit of displacements, preferred
    directions, or where stages are left out.

    Args:
        scene, mesh, pose: What was solved.
        found: What is kept within the bounds, with its pairs (K, 2).
        pairs_of: Finds the pairs of a pose (V, 3).
        options: The numbers.
    """
    surface, chosen, (judged, pairs) = mesh.surface, scene.options, found
    if chosen.method != "full" or chosen.skip or chosen.tighten == 0:
        return found
    if chosen.maximum_displacement is not None or scene.direction.any():
        return found
    if surface.clusters > 1 or surface.stiff.all():
        return found
    if not (len(pairs) or judged.excess or len(pose.enclosed)):
        return found
    than = rank_of(scene, pose, judged)
    if not any(than):
        return found
    unit = mesh.reduced(pose.centred)
    led = _led(surface, unit, chosen.effort, options)
    if led is None:
        return found
    points = mesh.expanded(pose.centred, unit, led)
    other = bounded_pose(
        scene, pose, Judged(points), pairs_of(points), pairs_of, options=options.share
    )
    rank = rank_of(scene, pose, other[0])
    return other if rank < than and rank[0] <= options.gain * than[0] else found


def _led(
    surface: Surface, pose: FloatArray, effort: float, options: ApproachOptions
) -> FloatArray | None:
    """Return a pose (V, 3) corrected on the way from the rest; None where that is too far."""
    most = options.work + options.work_a_triangle * len(surface.faces)
    enough = work_done() + effort * most
    between = PosesBetween(surface, pose, options=options.between)
    if lengths(pose - between.start).max() <= options.near:
        return None
    scale = contact_scale(surface, surface.contacts.pairs(pose))
    steering = Steering(surface)
    before = after = between.start
    share, step = 0.0, options.step
    while share < 1.0:
        if work_done() > enough:
            return None
        to, last = min(share + step, 1.0), step <= options.least_step
        own = between(to)
        start = carried(surface, before, own, after - before) if (after != before).any() else own
        points, value = solved_from(
            surface,
            own,
            start,
            scale=scale,
            alone=None,
            steering=steering,
            insist=last,
            effort=effort,
            options=options.lending,
        )
        if value > options.lending.rough and not last:
            step *= 0.5
            continue
        before, after, share = own, points, to
        # Where a longer step would begin, it is tried again.
        if step < options.step and (share / (2.0 * step)).is_integer():
            step *= 2.0
    return after
