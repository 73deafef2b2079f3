"""Poses that are solved alone and have a patch turned inside out are solved again, otherwise.

What meets near where it hangs together is a crease, and left to a fill. So are lips that close too
far, and the fill draws the mouth out between them, where it is round again, outside in. Pushed by
short steps, however near they hang together, lips often come apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from dtrepair.diagnosis import StrainKind
from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.full.method import FullMethod, FullOptions
from dtrepair.repair.scene.bounds import Bounded, rank_of
from dtrepair.repair.scene.opened_pose import OpenedPose
from dtrepair.repair.scene.scene import Scene
from dtrepair.repair.scene.welded_mesh import WeldedMesh


@dataclass(frozen=True, kw_only=True)
class TurnedOptions:
    """How poses are solved again of which a patch was turned inside out.

    Args:
        near, first_steps: What replaces these numbers of the phases, see `PhaseOptions`.
        gain: The other solution has to leave at most this share of what is wrong: the usual one
            tells what strains it.
    """

    near: tuple[int, ...] = (6, 0)
    first_steps: tuple[float, ...] = (0.005,)
    gain: float = 0.5


def turned_back(
    scene: Scene,
    mesh: WeldedMesh,
    pose: OpenedPose,
    found: Bounded,
    bounded: Callable[[FloatArray], Bounded],
    full: FullOptions = FullOptions(),
    options: TurnedOptions = TurnedOptions(),
) -> Bounded:
    """Return what is kept of a pose, or of a second solution where a patch of the first turned.

    The better of the two. Not where stages are left out, and of one cluster only: what is led
    apart as a whole does not begin at its input.

    Args:
        scene, mesh, pose: What was solved.
        found: What is kept within the bounds, with its pairs (K, 2).
        bounded: Returns the same of another solution (V, 3).
        full: Numbers of the method.
        options: What is different then.
    """
    chosen, surface = scene.options, mesh.surface
    turned = any(own.kind == StrainKind.FLIPS for own in found[0].excess)
    if not turned or chosen.skip or chosen.tighten == 0 or surface.clusters > 1:
        return found
    unit = mesh.reduced(pose.centred)
    phases = replace(full.phases, near=options.near, first_steps=options.first_steps)
    method = FullMethod(
        surface,
        rounds=chosen.tighten,
        farthest=mesh.farthest,
        effort=chosen.effort,
        options=replace(full, phases=phases),
    )
    other = bounded(mesh.expanded(pose.centred, unit, method(unit).points))
    than, rank = (rank_of(scene, pose, own[0]) for own in (found, other))
    return other if rank < than and rank[0] <= options.gain * than[0] else found
