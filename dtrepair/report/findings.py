"""What a repair that ends clean may still be looked at for: how its corrections go in time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from dtrepair.wording import frames_named, listed


class FindingKind(StrEnum):
    """What corrections do, in the order in which it is told."""

    BENT = "bent"
    MOVED = "moved"
    BREAKS_OFF = "breaks_off"
    JUMPS = "jumps"


# Before and after the names of the meshes, and their frames.
_WORDS = {
    FindingKind.BENT: (
        "bent, though moved as a whole in the input",
        "where that must not be, --rigid keeps the shape of what it names, and what it touches "
        "gives way instead",
    ),
    FindingKind.MOVED: (
        "moved, though it stands still in the input",
        "where that must not be, --collider keeps what it names in its place, and what meets it "
        "gives way instead",
    ),
    FindingKind.BREAKS_OFF: (
        "corrections that break off with --frames",
        "frames beside these were not chosen and stay as they are, so that it pops, or between "
        "far keys fades unseen; for what is kept leave --frames out, or choose frames without "
        "contacts at both ends as well, of keys too",
    ),
    FindingKind.JUMPS: (
        "corrections that jump",
        "what moves there stands out from the frames before and after, perhaps on the other side "
        "of something: look at these frames",
    ),
}


@dataclass(frozen=True, kw_only=True)
class MotionFinding:
    """What the corrections of a mesh do in some frames.

    largest: how far, in the worst frame, as a fraction of the size of the mesh.
    """

    kind: FindingKind
    path: str
    largest: float
    times: tuple[float, ...]

    def __str__(self) -> str:
        """Name the mesh, its frames, and how far."""
        return (
            f"{self.path} in {frames_named(self.times)} "
            f"(by up to {100.0 * self.largest:.2g} % of its size)"
        )

    def document(self) -> dict[str, Any]:
        """Return the finding as plain values."""
        return {**asdict(self), "kind": str(self.kind), "times": list(self.times)}


def warnings_of(findings: Iterable[MotionFinding]) -> tuple[str, ...]:
    """Return a line for each kind of finding: its meshes, the worst first, and what cures it."""
    every, lines = sorted(findings, key=lambda own: -own.largest), list[str]()
    for kind, (what, cure) in _WORDS.items():
        if names := [str(own) for own in every if own.kind is kind]:
            lines.append(f"{what}: {listed(names)}; {cure}")
    return tuple(lines)


def joined(documents: Iterable[Mapping[str, Any]]) -> tuple[MotionFinding, ...]:
    """Return findings of chunks of one run as those of the whole, read from JSON."""
    met: dict[tuple[FindingKind, str], list[Mapping[str, Any]]] = {}
    for own in documents:
        met.setdefault((FindingKind(own["kind"]), own["path"]), []).append(own)
    order = list(FindingKind)
    return tuple(
        MotionFinding(
            kind=kind,
            path=path,
            largest=max(each["largest"] for each in own),
            times=tuple(sorted({time for each in own for time in each["times"]})),
        )
        for (kind, path), own in sorted(met.items(), key=lambda each: order.index(each[0][0]))
    )
