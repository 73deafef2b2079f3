"""Poses of which a patch was turned inside out are solved again, by short pushes.

What meets near where it hangs together is a crease, and left to a fill. So are lips that close too
far, and the fill draws the mouth out between them, where it is round again, outside in. Pushed by
short steps, however near they hang together, lips come apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.full.phases import PhaseOptions
from dtrepair.repair.scene.bounds import Bounded, rank_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh


@dataclass(frozen=True, kw_only=True)
class TurnedOptions:
    """How poses are solved again of which a patch was turned inside out.

    Args:
        phases: Numbers of the push, instead of those of the full method.
    """

    phases: PhaseOptions = field(
        default_factory=lambda: PhaseOptions(near=(6, 0), first_steps=(0.005,))
    )


def turned_back(
    scene: Scene,
    mesh: WeldedMesh,
    pose: OpenedPose,
    found: Bounded,
    bounded: Callable[[FloatArray], Bounded],
    full: FullOptions = FullOptions(),
    options: TurnedOptions = TurnedOptions(),
) -> Bounded:
    """Return what is kept of a pose, if a patch was turned inside out perhaps of another solution.

    Args:
        scene, mesh, pose: What was solved.
        found: What is kept within the bounds, with its pairs (K, 2).
        bounded: Returns the same of another solution (V, 3).
        full: Numbers of the method.
        options: What is different then.
    """
    turned = any(own.kind == StrainKind.FLIPS for own in found[0].excess)
    if scene.options.method != "full" or not turned:
        return found
    chosen, unit = scene.options, mesh.reduced(pose.centred)
    method = FullMethod(
        mesh.surface,
        rounds=chosen.tighten,
        farthest=mesh.farthest,
        skip=chosen.skip,
        effort=chosen.effort,
        options=replace(full, phases=options.phases),
    )
    other = bounded(mesh.expanded(pose.centred, unit, method(unit).points))
    better = rank_of(scene, pose, other[0]) < rank_of(scene, pose, found[0])
    return other if better else found
