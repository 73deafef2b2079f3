"""What a repair that ends clean may still be looked at for: how its corrections go in time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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


# Before and after the names of the meshes, and their frames; of a trial there is one sentence.
_WORDS = {
    FindingKind.BENT: (
        "bent, though moved as a whole in the input",
        "where that must not be, --rigid keeps the shape of what it names; what it touches gives "
        "way instead, or keeps contacts",
    ),
    FindingKind.MOVED: (
        "moved, though it stands still in the input",
        "where that must not be, --collider keeps what it names in its place, and what meets it "
        "gives way instead",
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
    for kind in FindingKind:
        if not (found := [own for own in every if own.kind is kind]):
            continue
        if kind is FindingKind.BREAKS_OFF:
            lines.append(_trial(found))
        else:
            what, cure = _WORDS[kind]
            lines.append(f"{what}: {listed(list(map(str, found)))}; {cure}")
    return tuple(lines)


def _trial(found: Sequence[MotionFinding]) -> str:
    """Say that chosen frames at whose ends corrections break off, the worst first, are a trial."""
    times = {time for own in found for time in own.times}
    return (
        "--frames is a trial: leave it out for the final repair, or choose ends without contacts; "
        f"the correction breaks off at {frames_named(times)} and pops, or fades unseen, there, "
        f"most at {found[0].path} (by {100.0 * found[0].largest:.2g} % of its size)"
    )


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
