"""Where a repaired character suffers: parts and pairs of parts behind the figures of a row."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from benchmarks.character_measures import Input
from tests.measures.modelled_zones import drift
from tests.measures.motion import box_diagonal, edge_ratios, volume_changes
from tests.measures.surfaces import Floats, Ints

MOST = 6  # places of each kind

# What is wrong there, by name: the worst first.
Places = dict[str, list[tuple[str, float]]]


def places(known: Input, after: Floats, frames: Ints) -> Places:
    """The worst places of a character (T, V, 3), each in its worst frame.

    left: real pairs of two parts; drift: of an attachment, over the diagonal; edges: how many of a
    part became four times longer or shorter; volume: change of a closed part; move: of a part,
    over the diagonal.
    """
    surface, names = known.surface, part_names(known)
    worst: dict[str, dict[str, float]] = {
        kind: {} for kind in ("left", "drift", "edges", "volume", "move")
    }

    def note(kind: str, found: Iterable[tuple[str, float]]) -> None:
        for name, value in found:
            if abs(value) > abs(worst[kind].get(name, 0.0)):
                worst[kind][name] = value

    for points, frame in zip(after, frames, strict=True):
        before = known.character.poses[frame]
        size = box_diagonal(before)
        old, new = known.welded(before), known.welded(points)
        pairs = known.pairs_of(points)
        of = np.sort(surface.part_of_face[pairs[~known.zones.modelled(pairs)]], axis=1)
        for (a, b), count in zip(*np.unique(of, axis=0, return_counts=True), strict=True):
            note("left", [(_both(names, a, b), float(count))])
        for own in known.attachments:
            slid = float(drift(own.ties, old, new).max(initial=0.0)) / size
            note("drift", [(_both(names, own.sides[0].part, own.sides[1].part), slid)])
        ratio = edge_ratios(surface, old, new)
        spoilt = surface.edges[(ratio > 4.0) | (ratio < 0.25), 0]
        count = np.bincount(surface.part_of_vertex[spoilt], minlength=surface.parts)
        note("edges", zip(names, count.tolist(), strict=True))
        change = np.nan_to_num(volume_changes(surface, old, new))
        note("volume", zip(names, change.tolist(), strict=True))
        far = np.zeros(surface.parts)
        used = surface.part_of_vertex >= 0
        moved = np.linalg.norm(new - old, axis=1)[used] / size
        np.maximum.at(far, surface.part_of_vertex[used], moved)
        note("move", zip(names, far.tolist(), strict=True))
    return {
        kind: sorted(own.items(), key=lambda item: -abs(item[1]))[:MOST]
        for kind, own in worst.items()
    }


def part_names(known: Input) -> list[str]:
    """Prim and number within it of each part, the number left out where there is one part only."""
    character, surface = known.character, known.surface
    first = np.unique(surface.part_of_face, return_index=True)[1]
    mesh = character.owner[character.faces[first, 0]]
    names = ["/".join(character.paths[own].split("/")[-2:]) for own in mesh]
    return [
        name if (mesh == own).sum() == 1 else f"{name}#{int((mesh[:part] == own).sum())}"
        for part, (name, own) in enumerate(zip(names, mesh, strict=True))
    ]


def _both(names: list[str], a: int, b: int) -> str:
    return names[a] if a == b else f"{names[a]} - {names[b]}"


def lines(found: Places) -> str:
    """The places as text, one line for each kind."""
    return "\n".join(
        f"  {kind}: " + ", ".join(f"{name} {value:.3g}" for name, value in own)
        for kind, own in found.items()
        if own
    )
