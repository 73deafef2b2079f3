"""What a user may choose."""

from __future__ import annotations

from dataclasses import dataclass
from math import isinf
from numbers import Integral

from dtrepair.intersect import MODES

METHODS = ("full", "paper")
OPTIMIZERS = ("momentum-brake", "uniform-adam", "adam", "gradient-descent")
ENERGIES = ("signed-tpe", "tpe", "point-to-plane", "conical")
LAPLACIANS = ("rest", "input")
BRAKE_MASKS = ("component", "vertex")
# Energies with two exponents.
TANGENT_POINT = ("signed-tpe", "tpe")
# Stages of the full method that can be left out.
STAGES = (
    "volume",
    "sections",
    "fill",
    "insist",
    "pull-back",
    "relax",
    "edges",
    "unbend",
    "approach",
)
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
        laplacian: Pose that the Laplacian of the paper's loop is of: "rest", factored once for all
            poses, or "input", the pose itself, as published.
        kernel_exponent: Of the height in the tangent-point energies, odd; None: 1, as the authors'
            code has it. Their text has 3.
        kernel_power: Of the distance in the tangent-point energies; None: 1. Their text has 6.
        learning_rate: Of the paper's optimiser; None: what suits it and the energy.
        brake_band: Half width of the band of "momentum-brake", standard deviations; None: 3.
        brake_mask: What leaves that band: a "component" (None) or a "vertex" with all of its three.
        tighten: Rounds that pull a clean result back towards the input; 0 switches it off.
        maximum_displacement: No vertex moves farther, in length units; None: no limit.
        clearance: Distance that triangles of a result keep that are not neighbours, length units.
        at_any_cost: Keep the whole correction where it strains a shape beyond the bounds; else the
            best pose within them is kept, and what is left is told.
        skip: Stages of the full method to leave out, of STAGES; with any of them no pose is led in
            from the rest ("approach").
        rest_contacts: What to do with intersections that the rest pose has as well: "auto" takes
            those of different connected parts as modelled, leaves and holds them together; "repair"
            or "leave" them all.
        inner_mobility: How freely what open layers lie over is pushed, next to them, from above 0
            to 1, and beneath two of them by its square. Below 1 the body gives way less than its
            clothes, but joints of overlapping pieces bend worse.
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
    laplacian: str = "rest"
    kernel_exponent: int | None = None
    kernel_power: float | None = None
    learning_rate: float | None = None
    brake_band: float | None = None
    brake_mask: str | None = None
    tighten: int = 4
    maximum_displacement: float | None = None
    clearance: float = 0.0
    rest_contacts: str = "auto"
    inner_mobility: float = 1.0
    effort: float = 1.0
    at_any_cost: bool = False
    skip: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check every choice."""
        self._check_names()
        self._check_numbers()
        self._check_loop()
        limit = self.maximum_displacement
        if limit is not None and not limit > 0:
            raise OptionError("maximum_displacement", f"should be above 0, got {limit}")
        if self.method == "paper" and (limit is not None or self.clearance):
            raise OptionError(
                "maximum_displacement",
                "and clearance should be left out with the method paper, which knows neither: "
                'use "full"',
            )

    def _check_names(self) -> None:
        names: dict[str, tuple[str | None, ...]] = {
            "method": METHODS,
            "mode": MODES,
            "optimizer": OPTIMIZERS,
            "energy": ENERGIES,
            "laplacian": LAPLACIANS,
            "brake_mask": (None, *BRAKE_MASKS),
            "rest_contacts": REST_CONTACTS,
        }
        for name, allowed in names.items():
            if getattr(self, name) not in allowed:
                known = ", ".join(filter(None, allowed))
                raise OptionError(name, f"should be one of {known}, got {getattr(self, name)!r}")
        if unknown := set(self.skip) - set(STAGES):
            known = ", ".join(STAGES)
            raise OptionError("skip", f"should hold some of {known}, got {sorted(unknown)}")

    def _check_numbers(self) -> None:
        for name in ("iterations", "tighten", "kernel_exponent"):
            if not isinstance(getattr(self, name), Integral | None):
                raise OptionError(name, f"should be a whole number, got {getattr(self, name)}")
        for name in (
            "diffusion",
            "regularization",
            "clearance",
            "maximum_displacement",
            "inner_mobility",
            "effort",
            "kernel_power",
            "learning_rate",
            "brake_band",
        ):
            if isinf(getattr(self, name) or 0.0):
                raise OptionError(name, f"should be finite, got {getattr(self, name)}")
        least = {"iterations": 1, "tighten": 0, "regularization": 0.0, "clearance": 0.0}
        for name, lowest in least.items():
            if not getattr(self, name) >= lowest:
                raise OptionError(name, f"should be at least {lowest}, got {getattr(self, name)}")
        positive = (
            "diffusion",
            "inner_mobility",
            "effort",
            "kernel_power",
            "learning_rate",
            "brake_band",
        )
        for name in positive:
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise OptionError(name, f"should be positive, got {value}")
        if self.inner_mobility > 1.0:
            raise OptionError("inner_mobility", f"should be at most 1, got {self.inner_mobility}")

    def _check_loop(self) -> None:
        """Check the numbers of the published loop that only some of its parts have."""
        exponent = self.kernel_exponent
        if exponent is not None and (exponent < 1 or exponent % 2 == 0):
            raise OptionError(
                "kernel_exponent",
                f"should be odd and positive, got {exponent}: an even one loses the sign",
            )
        for name in ("kernel_exponent", "kernel_power"):
            if getattr(self, name) is not None and self.energy not in TANGENT_POINT:
                known = " and ".join(TANGENT_POINT)
                raise OptionError(name, f"is of the energies {known}, got {self.energy!r}")
        for name in ("brake_band", "brake_mask"):
            if getattr(self, name) is not None and self.optimizer != "momentum-brake":
                raise OptionError(name, f"is of momentum-brake, got {self.optimizer!r}")
