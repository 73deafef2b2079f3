"""The step of a pose whose contacts hold: an elastic system with gaps that must stay open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtrepair.numerics.geometry import FloatArray
from dtrepair.repair.elastic.arap import ArapSystem
from dtrepair.repair.elastic.gaps import Gaps


@dataclass(frozen=True, kw_only=True)
class ContactStepOptions:
    """Numbers of the solver of a step with contacts.

    Args:
        rounds: Of the augmented Lagrangian: three settle the forces of a contact.
        iterations: Most iterations of conjugate gradients in a round.
        precision: Fraction of the first squared error, in the norm of the factor, at which a round
            ends: the next round changes the forces by more than that.
    """

    rounds: int = 3
    iterations: int = 60
    precision: float = 5e-3


def step_with_gaps(
    system: ArapSystem,
    right: FloatArray,
    gaps: Gaps,
    start: FloatArray,
    *,
    rounds: int | None = None,
    options: ContactStepOptions = ContactStepOptions(),
) -> FloatArray:
    """Return the pose of a step (V, 3) whose gaps stay open; change the gaps' forces.

    Rounds of an augmented Lagrangian (`rounds`, default: those of the options). Each one solves
    with the stiff gaps that are active, by conjugate gradients from `start` with the factor of the
    bare system as preconditioner.
    """
    solution, image = start, system.image(start)
    if len(gaps) == 0:
        return solution + system.solve(right - image)
    for _ in range(options.rounds if rounds is None else rounds):
        lacking = gaps.least - gaps.width(solution)
        active = gaps.forces + gaps.stiffness * lacking > 0
        stiffness = gaps.stiffness * active
        residual = right + gaps.spread(stiffness * lacking + active * gaps.forces) - image
        # As the preconditioner is the system's own factor, its images come without products.
        search = preconditioned = system.solve(residual)
        searched = residual
        energy = first = float(np.vdot(residual, preconditioned))
        for _ in range(options.iterations):
            if energy <= options.precision * first:
                break
            stiff = searched + gaps.spread(stiffness * gaps.width(search))
            length = energy / max(float(np.vdot(search, stiff)), 1e-300)
            solution = solution + length * search
            image = image + length * searched
            residual = residual - length * stiff
            preconditioned = system.solve(residual)
            following = float(np.vdot(residual, preconditioned))
            search = preconditioned + following / energy * search
            searched = residual + following / energy * searched
            energy = following
        gaps.forces = np.maximum(
            0.0, gaps.forces + gaps.stiffness * (gaps.least - gaps.width(solution))
        )
    return solution
