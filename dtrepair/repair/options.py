"""What a user may choose."""

from __future__ import annotations

from dataclasses import dataclass
from math import isinf
from numbers import Integral

from dtrepair.intersect import MODES

METHODS = ("full", "paper")
OPTIMIZERS = ("momentum-brake", "uniform-adam", "gradient-descent")
ENERGIES = ("signed-tpe", "tpe", "point-to-plane", "conical")
# Stages of the full method that can be left out.
STAGES = ("volume", "fill", "insist", "pull-back", "relax", "edges", "unbend")
REST_CONTACTS = ("auto", "repair", "leave")


class OptionError(ValueError):
    """A choice that cannot be.

    Attributes:
        option: Name of the option.
        reason: What it should be, and what it is.
    """

    def __init__(self, option: str, reason: str) -> None:
        """Name the option, and what is wrong with it."""
        super().__init__(f"{option} {reason}")
        self.option, self.reason = option, reason

    def __reduce__(self) -> tuple[type[OptionError], tuple[str, str]]:
        """Come whole out of another process."""
        return type(self), (self.option, self.reason)


@dataclass(frozen=True, kw_only=True)
class RepairOptions:
    """Choices of a repair; the defaults suit characters.

    Args:
        method: "full", or "paper" for the published algorithm alone.
        mode: Contacts to repair: within a body ("self"), between bodies ("inter") or both.
        diffusion: lambda of the diffusion: how far a push spreads.
        iterations: Most iterations of the paper's loop.
        regularization: beta of the paper's shape term, times the mean square.
        optimizer: Of the paper's loop.
        energy: Of the paper's loop.
        tighten: Rounds that pull a clean result back towards the input; 0 switches it off.
        maximum_displacement: No vertex moves farther, in length units; None: no limit.
        clearance: Distance that triangles of a result keep that are not neighbours, length units.
        at_any_cost: Keep the whole correction where it strains a shape beyond the bounds; else the
            best pose within them is kept, and what is left is told.
        skip: Stages of the full method to leave out, of STAGES.
        rest_contacts: What to do with intersections that the rest pose has as well: "auto" takes
            those of different connected parts as modelled, leaves and holds them together; "repair"
            or "leave" them all.
        effort: Factor of the work that is spent on a pose before what is left is told; the work is
            counted, so that results are the same on any machine.

    Raises:
        OptionError: a ValueError; an unknown name or a number out of range.
    """

    method: str = "full"
    mode: str = "both"
    diffusion: float = 99.0
    iterations: int = 60
    regularization: float = 1e6
    optimizer: str = "momentum-brake"
    energy: str = "signed-tpe"
    tighten: int = 4
    maximum_displacement: float | None = None
    clearance: float = 0.0
    rest_contacts: str = "auto"
    effort: float = 1.0
    at_any_cost: bool = False
    skip: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check every choice."""
        names = {
            "method": METHODS,
            "mode": MODES,
            "optimizer": OPTIMIZERS,
            "energy": ENERGIES,
            "rest_contacts": REST_CONTACTS,
        }
        for name, allowed in names.items():
            if getattr(self, name) not in allowed:
                raise OptionError(
                    name, f"should be one of {', '.join(allowed)}, got {getattr(self, name)!r}"
                )
        if unknown := set(self.skip) - set(STAGES):
            known = ", ".join(STAGES)
            raise OptionError("skip", f"should hold some of {known}, got {sorted(unknown)}")
        for name in ("iterations", "tighten"):
            if not isinstance(getattr(self, name), Integral):
                raise OptionError(name, f"should be a whole number, got {getattr(self, name)}")
        for name in (
            "diffusion",
            "regularization",
            "clearance",
            "maximum_displacement",
            "effort",
        ):
            if isinf(getattr(self, name) or 0.0):
                raise OptionError(name, f"should be finite, got {getattr(self, name)}")
        least = {"iterations": 1, "tighten": 0, "regularization": 0.0, "clearance": 0.0}
        for name, lowest in least.items():
            if not getattr(self, name) >= lowest:
                raise OptionError(name, f"should be at least {lowest}, got {getattr(self, name)}")
        for name in ("diffusion", "effort"):
            if not getattr(self, name) > 0:
                raise OptionError(name, f"should be positive, got {getattr(self, name)}")
        limit = self.maximum_displacement
        if limit is not None and not limit >= 0:
            raise OptionError("maximum_displacement", f"should be at least 0, got {limit}")
        if self.method == "paper" and (limit is not None or self.clearance):
            raise OptionError(
                "maximum_displacement",
                "and clearance should be left out with the method paper, which knows neither: "
                'use "full"',
            )
