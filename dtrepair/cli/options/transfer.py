"""What a transfer was asked for, and its clock."""

from __future__ import annotations

import time as clock
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from dtrepair.pipeline.selection import Selection

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions


@dataclass(frozen=True, kw_only=True)
class TransferOptions:
    """What the user chose.

    repair: options of the repair, None for none. alone: each frame is repaired for itself; None:
    poses in mesh files are, the frames of a stage are repaired together.
    """

    source_path: str
    target_path: str
    poses: tuple[str, ...] = ()
    markers: str | None = None
    correspondence: str | None = None
    save_correspondence: str | None = None
    rest: str | None = None
    target_prim: str | None = None
    source_up: str | None = None
    target_up: str | None = None
    align: str = "axes"
    root_scale: float | None = None
    ground: bool = False
    pin: str | None = None
    picture: str | None = None
    dry_run: bool = False
    shapes: bool = False
    alone: bool | None = None
    repair: RepairOptions | None = None


@dataclass
class Inputs:
    """A run: options, where it computes, and the seconds of its parts."""

    options: TransferOptions
    selection: Selection
    device: str
    jobs: int
    warnings: list[str] = field(default_factory=list)
    late: list[str] = field(default_factory=list)  # warnings that come while it runs
    seconds: dict[str, float] = field(default_factory=dict)
    start: float = field(default_factory=clock.perf_counter)
    last: float = field(default_factory=clock.perf_counter)

    def lap(self, name: str) -> None:
        """Give the time since the last lap to a part."""
        now = clock.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self.last
        self.last = now

    def settings(self) -> dict[str, Any]:
        """What a report and an output say of the choices."""
        chosen = {**vars(self.selection), **vars(self.options)}
        repair = chosen.pop("repair")
        chosen |= {"repair": repair is not None, **(asdict(repair) if repair else {})}
        chosen["poses"] = list(self.options.poses)
        del chosen["dry_run"]
        return {name: value for name, value in chosen.items() if value is not None}
