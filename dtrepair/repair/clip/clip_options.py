"""How clips are cut into windows, and the numbers of what their frames go through."""

from __future__ import annotations

from dataclasses import dataclass, field

from dtrepair.repair.clip.layout import LayoutOptions
from dtrepair.repair.clip.steady_frames import AgreeOptions
from dtrepair.repair.clip.window_method import WindowOptions
from dtrepair.repair.full.mend import MendOptions
from dtrepair.repair.full.method import FullOptions
from dtrepair.repair.independent_options import IndependentOptions
from dtrepair.repair.relief.approach import ApproachOptions
from dtrepair.repair.relief.borrowing import BorrowingOptions
from dtrepair.repair.relief.inside_out import InsideOutOptions
from dtrepair.repair.relief.other_ways import OtherWayOptions
from dtrepair.repair.scene.props import MachineOptions


@dataclass(frozen=True, kw_only=True)
class ClipOptions(LayoutOptions):
    """How clips are cut into windows, and what their frames are given.

    Args:
        tighten: Most cycles of tightening, even if the user's options allow more: later ones gain
            little.
        mend_step: Step, in units of the size, of a frame whose correction misses by rounding only.
        mend_share: A frame that keeps only a share of its correction is mended by motions up to
            this, units of the size: it must not stand out from its neighbours.
        longest_hold: Frames that hold a pose are solved as one; without a fault, so many at most.
        solving: Share of a window's work that solving is taken to be, for the progress that is
            told; judging and what goes again are the rest.
        ways: Which other ways through strained frames are taken.
        machine: When the bodies of a machine stay rigid.
        windows: Numbers of the stages of a window.
        mend: Numbers of the mending of that frame.
        inside_out: When bodies are repaired before their clothes.
        borrow: When frames start again from their neighbours.
        agree: How those of a single skin that did agree with the frames around.
        alone: Numbers of the full method, for frames that no window could clean.
        independent: How bodies are led apart, and how frames are solved that are repaired each for
            itself. They are led in from the rest with less work than single poses: mostly their
            neighbours have shown the way, if there is one.
    """

    tighten: int = 3
    mend_step: float = 0.002
    mend_share: float = 0.005
    longest_hold: int = 4
    solving: float = 0.7
    windows: WindowOptions = field(default_factory=WindowOptions)
    mend: MendOptions = field(default_factory=MendOptions)
    ways: OtherWayOptions = field(default_factory=OtherWayOptions)
    machine: MachineOptions = field(default_factory=MachineOptions)
    inside_out: InsideOutOptions = field(default_factory=InsideOutOptions)
    borrow: BorrowingOptions = field(default_factory=BorrowingOptions)
    agree: AgreeOptions = field(default_factory=AgreeOptions)
    alone: FullOptions = field(default_factory=FullOptions)
    independent: IndependentOptions = field(
        default_factory=lambda: IndependentOptions(
            approach=ApproachOptions(work=2e6, work_a_triangle=40.0)
        )
    )
