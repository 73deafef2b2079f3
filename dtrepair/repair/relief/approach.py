"""What no push frees is led to its pose from the rest, where nothing has gone through anything yet.

A hand that is behind the back in the rest, and in a pose has gone through the hip, has no way out
that could be seen in that pose. On the way from the rest it meets the hip from its own side, stays
there, and the correction is carried on to the pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from dtrepair.numerics.geometry import FloatArray, lengths
from dtrepair.numerics.work import work_done
from dtrepair.repair.elastic.poses_between import PosesBetween
from dtrepair.repair.frame.lending import LendingOptions, carried, solved_from
from dtrepair.repair.full.steering import Steering
from dtrepair.repair.scene.bounds import badness, strain_of, wrong_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh
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
        lending: What cleans a pose on the way from what the one before was corrected by.
    """

    step: float = 0.25
    least_step: float = 1 / 16
    near: float = 1e-3
    work: float = 5.5e6
    work_a_triangle: float = 60.0
    lending: LendingOptions = field(default_factory=LendingOptions)


def approached(
    scene: Scene,
    mesh: WeldedMesh,
    pose: OpenedPose,
    found: FloatArray,
    *,
    options: ApproachOptions = ApproachOptions(),
) -> FloatArray:
    """Return what was found (V, 3) for a pose; if that is no repair, a better one from the rest.

    Of what holds together: free bodies have no common rest. Not with a clearance, which relaxing
    would close, nor with preferred directions.
    """
    surface, chosen = mesh.surface, scene.options
    if chosen.method != "full" or chosen.clearance > 0.0 or "approach" in chosen.skip:
        return found
    if scene.direction.any() or surface.clusters > 1 or surface.stiff.all():
        return found
    than = _merit(scene, pose, found)
    if not any(than[:2]):
        return found
    unit = mesh.reduced(pose.centred)
    points = _led(surface, unit, chosen.effort, options)
    if points is None:
        return found
    other = mesh.expanded(pose.centred, unit, points)
    limit = chosen.maximum_displacement
    if limit is not None and lengths(other - pose.centred).max() > limit:
        return found
    return other if _merit(scene, pose, other) < than else found


def _merit(scene: Scene, pose: OpenedPose, points: FloatArray) -> tuple[bool, int, float]:
    """Return whether a pose (V, 3) is strained, what is wrong with it, how far it is strained."""
    excess = strain_of(scene, pose.centred, points)
    return bool(excess), wrong_of(scene, pose, points), badness(excess)


def _led(
    surface: Surface, pose: FloatArray, effort: float, options: ApproachOptions
) -> FloatArray | None:
    """Return a pose (V, 3) corrected on the way from the rest; None where that is too far."""
    enough = work_done() + effort * (options.work + options.work_a_triangle * len(surface.faces))
    between = PosesBetween(surface, pose)
    if lengths(pose - between.start).max() <= options.near:
        return None
    scale = contact_scale(surface, surface.contacts.pairs(pose))
    before = after = between.start
    share, step = 0.0, options.step
    while share < 1.0:
        if work_done() > enough:
            return None
        own, last = between(share + step), step <= options.least_step
        start = carried(surface, before, own, after - before) if (after != before).any() else own
        points, value = solved_from(
            surface,
            own,
            start,
            scale=scale,
            alone=None,
            steering=Steering(surface),
            insist=last,
            effort=effort,
            options=options.lending,
        )
        if value > options.lending.rough and not last:
            step *= 0.5
            continue
        before, after = own, points
        share += step
    return after
