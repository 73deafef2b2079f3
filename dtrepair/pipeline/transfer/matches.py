"""Which mesh of the target follows which of the source, where either side has several."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.stages.matching import matching_meshes
from dtrepair.pipeline.stages.sources import Source
from dtrepair.pipeline.transfer.options import TransferOptions
from dtrepair.pipeline.transfer.pair import JoinedMeshes
from dtrepair.wording import listed


class Match(NamedTuple):
    """A mesh of the source and one of the target, by place; markers: the file that ties them."""

    source: int
    target: int
    markers: str | None = None


def choose_matches(
    source: JoinedMeshes, target: JoinedMeshes, options: TransferOptions
) -> list[Match]:
    """Return who follows whom: as --match says, the largest meshes by --markers, else by topology.

    Of several meshes of one topology that of the same name counts, else the next one that nothing
    follows yet. Target meshes that are in no match follow the nearest part.
    """
    found = [_asked(source, target, text) for text in options.match]
    if options.markers is not None:
        found.append(Match(_largest(source), _largest(target), options.markers))
    known = {match.target for match in found}
    found += list(_of_one_topology(source, target, known, {match.source for match in found}))
    if not found:
        raise UsageError(
            f"{target.source.name}: no mesh has the topology of one of {source.source.name} "
            f"({listed(target.paths)} and {listed(source.paths)}): give --markers for the largest "
            "of each, or --match; or choose meshes with --prim and --target-prim"
        )
    return found


def _asked(source: JoinedMeshes, target: JoinedMeshes, text: str) -> Match:
    """Read "A,B" or "A,B=FILE"."""
    names, _, path = text.partition("=")
    first, comma, second = names.partition(",")
    if not (comma and first.strip() and second.strip()):
        raise UsageError(
            f'--match {text}: expected a prim of SOURCE and one of TARGET, such as "/Cat,/Lion" '
            'or "/Cat,/Lion=markers.cons"'
        )
    places = _place(source, first, text), _place(target, second, text)
    return Match(*places, path.strip() or None)


def _place(side: JoinedMeshes, expression: str, text: str) -> int:
    meshes: Source = side.source
    found = [k for k in matching_meshes(meshes, expression, f"--match {text}") if k in side.moving]
    if len(found) != 1:
        raise UsageError(f"--match {text}: {expression.strip()} is {len(found)} meshes, expected 1")
    return side.moving.index(found[0])


def _largest(side: JoinedMeshes) -> int:
    counts = [len(side.part(place)[1]) for place in range(len(side.moving))]
    return int(np.argmax(counts))


def _of_one_topology(
    source: JoinedMeshes, target: JoinedMeshes, known: set[int], used: set[int]
) -> Iterator[Match]:
    shapes = [source.part(place)[1] for place in range(len(source.moving))]
    names = [path.rpartition("/")[2] for path in source.paths]
    for place, path in enumerate(target.paths):
        if place in known:
            continue
        own = target.part(place)[1]
        same = [k for k, faces in enumerate(shapes) if np.array_equal(faces, own)]
        named = [k for k in same if names[k] == path.rpartition("/")[2]]
        fresh = [k for k in same if k not in used]
        if same:
            chosen = (named or fresh or same)[0]
            used.add(chosen)
            yield Match(chosen, place)
