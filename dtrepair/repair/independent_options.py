"""Every number of how single poses are repaired, and how many at once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dtrepair.repair.frame.turned_poses import TurnedOptions
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.method import FullOptions
from dtrepair.repair.options import RepairOptions
from dtrepair.repair.relief.approach import ApproachOptions
from dtrepair.repair.relief.bodies_first import BodiesFirstOptions
from dtrepair.repair.relief.followers import FollowerOptions
from dtrepair.repair.relief.opening import OpeningOptions
from dtrepair.repair.relief.props import PropsBackOptions
from dtrepair.repair.relief.relief import ReliefOptions
from dtrepair.repair.separation.layer_lift import LiftOptions
from dtrepair.repair.separation.release import ReleaseOptions
from dtrepair.repair.separation.separation import SeparationOptions
from dtrepair.repair.separation.sunken import SunkenOptions
from dtrepair.repair.strain.bounds import StrainOptions
from dtrepair.repair.strain.shares import ShareOptions
from dtrepair.repair.torn_poses import TornOptions

if TYPE_CHECKING:
    # PyTorch is loaded for the published method only.
    from dtrepair.repair.paper.method import PaperOptions


@dataclass(frozen=True, kw_only=True)
class IndependentOptions:
    """How single poses are led apart, and which of them are solved once more.

    Args:
        torn: Which bodies are torn, and led apart otherwise.
        turned: How poses are solved again of which a patch was turned inside out.
        mend_step, mend: Largest motion, units of the size, and numbers of the mending of a share.
        strain: What a correction may do to a shape.
        relief: How what is strained is relaxed once more.
        bodies_first: How bodies are repaired before what they wear.
        approach: How what is strained or has pairs all the same is led in from the rest.
        followers: How loose parts go along with what they follow.
        props_back: How props come back.
        opening: How contacts are opened to the clearance.
        room: The clearance is room for other poses, which nobody asked for: what has no contacts
            keeps every bit, and what stays nearer is not told.
        share: How the share of a correction is found that does not do more.
        release: How enclosed parts are led out.
        lift, sunken: How layers are led back over what came through them, and parts out of what
            they sit on.
        separation: How bodies that penetrate each other are led apart.
        full: Numbers of the full method.
        paper: Numbers of the published method; None: `PaperOptions()`.
    """

    torn: TornOptions = field(default_factory=TornOptions)
    turned: TurnedOptions = field(default_factory=TurnedOptions)
    mend_step: float = 0.002
    mend: MendOptions = field(default_factory=MendOptions)
    strain: StrainOptions = field(default_factory=StrainOptions)
    relief: ReliefOptions = field(default_factory=ReliefOptions)
    bodies_first: BodiesFirstOptions = field(default_factory=BodiesFirstOptions)
    approach: ApproachOptions = field(default_factory=ApproachOptions)
    followers: FollowerOptions = field(default_factory=FollowerOptions)
    props_back: PropsBackOptions = field(default_factory=PropsBackOptions)
    opening: OpeningOptions = field(default_factory=OpeningOptions)
    room: bool = False
    share: ShareOptions = field(default_factory=ShareOptions)
    release: ReleaseOptions = field(default_factory=ReleaseOptions)
    lift: LiftOptions = field(default_factory=LiftOptions)
    sunken: SunkenOptions = field(default_factory=SunkenOptions)
    separation: SeparationOptions = field(default_factory=SeparationOptions)
    full: FullOptions = field(default_factory=FullOptions)
    paper: PaperOptions | None = None


def poses_at_once(options: RepairOptions, device: str, *, paper: PaperOptions | None = None) -> int:
    """Return how many poses are best solved at once: a GPU has room for many by the paper."""
    if options.method == "full" or device == "cpu":
        return 1
    from dtrepair.repair.paper.gpu_descent import GpuOptions

    return GpuOptions.batch if paper is None else paper.gpu.batch
