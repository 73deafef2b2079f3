"""Which meshes of an input an option speaks of, by a path expression, and which parts of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import ObjectSettings
from dtrepair.pipeline.stages.sources import Source, StageSource

# Pairs (i, j), i <= j, of meshes.
MeshPairs = tuple[tuple[int, int], ...]
# How lists name a connected part: its mesh, and its number there.
_PART = re.compile(r"(.*\S)\s+part\s+(\d+)")


class Side(NamedTuple):
    """One side of a pair that the user names: a mesh, or a connected part of it.

    part: its number in the mesh, as reports and lists tell it; 0 for all parts.
    """

    mesh: int
    part: int = 0


# Pairs of sides, the lower first.
SidePairs = tuple[tuple[Side, Side], ...]


def matching_meshes(source: Source, expression: str, option: str) -> list[int]:
    """Indices of the selected meshes that a path expression matches, or a prim above them.

    A usage error that names `option` if there is none, also of one of several expressions.
    """
    found = meshes_matched(source, expression, option)
    if not found:
        raise UsageError(f"{option}: {no_match(source, expression)}")
    from usd_io.expressions import union_terms

    for term in union_terms(expression):
        if not meshes_matched(source, term, option):
            raise UsageError(f"{option} {term}: {no_match(source, term)}")
    return found


def no_match(source: Source, expression: str | None = None) -> str:
    """Say that a path expression matches no mesh of a source, and what it may mean.

    expression: None for one whose prims need not be selected.
    """
    if expression is not None and isinstance(source, StageSource):
        from usd_io.expressions import meant

        guess = meant(source.opened.stage, expression, [mesh.path for mesh in source.meshes])
    else:
        guess = ""
    known = ", ".join(mesh.path for mesh in source.meshes[:3])
    more = " ..." if len(source.meshes) > 3 else ""
    return f"matches none of the selected meshes ({known}{more}){guess}"


def meshes_matched(source: Source, expression: str, option: str) -> list[int]:
    """Indices of the selected meshes that a path expression matches, or a prim above them.

    A usage error that names `option` for a malformed expression.
    """
    if not isinstance(source, StageSource):
        raise UsageError(f"{option}: only for USD stages; leave it out")
    from usd_io import SelectionError
    from usd_io.expressions import matching_paths

    try:
        paths = matching_paths(source.opened.stage, expression.strip())
    except SelectionError as error:
        raise UsageError(f"{option}: {error}") from None
    matched = {str(path) for path in paths}
    return [
        index
        for index, mesh in enumerate(source.meshes)
        if any(above in matched for above in _with_parents(mesh.path))
    ]


def ignored_pairs(source: Source, texts: Sequence[str]) -> MeshPairs:
    """Pairs of meshes (i, j), i <= j, that texts "A,B" of --ignore name; each may match several.

    "A,A" are the contacts of each mesh of A with itself and the others of A. A usage error for a
    text that is no pair, or names a part.
    """
    pairs = _side_pairs(source, texts, "--ignore")
    if any(side.part for pair in pairs for side in pair):
        raise UsageError("--ignore: expected two prims; parts of a mesh cannot be ignored")
    return tuple((first.mesh, second.mesh) for first, second in pairs)


def _side_pairs(source: Source, texts: Sequence[str], name: str) -> SidePairs:
    """Pairs of sides that texts "A,B" name; a usage error calls the option by its name."""
    pairs = set()
    for text in texts:
        sides = _split(text)
        option = f"{name} {text}"
        if len(sides) != 2 or not all(side.strip() for side in sides):
            raise UsageError(f'{option}: expected two prims, such as "/Hero/Hair,/Hero/Body"')
        first, second = (
            _sides(side, partial(matching_meshes, source, option=f"{option}: {side.strip()}"))
            for side in sides
        )
        named = {_sorted(one, other) for one in first for other in second}
        if any(one == other and one.part for one, other in named):
            raise UsageError(f"{option}: names one part twice; expected two parts")
        pairs |= named
    return tuple(sorted(pairs))


def _sides(text: str, matched: Callable[[str], list[int]]) -> list[Side]:
    """Return the meshes, or parts of meshes, that a text names; matched: finds those of prims."""
    named = _PART.fullmatch(text.strip())
    expression, part = (named[1], int(named[2])) if named else (text.strip(), 0)
    if named and part == 0:
        raise UsageError(f"{text.strip()}: expected a number from 1 on, as lists name parts")
    return [Side(mesh, part) for mesh in matched(expression)]


def _sorted(one: Side, other: Side) -> tuple[Side, Side]:
    return min(one, other), max(one, other)


class CalledPairs(NamedTuple):
    """Pairs of meshes, or of their parts, that the user calls attached, and those detached."""

    attached: SidePairs = ()
    detached: SidePairs = ()


def called_pairs(
    source: Source,
    each: Sequence[ObjectSettings],
    *,
    attach: Sequence[str] = (),
    detach: Sequence[str] = (),
) -> tuple[CalledPairs, list[str]]:
    """Return what is called attached or detached, and warnings.

    each: the settings of each mesh, which name others; attach, detach: pairs "A,B" of the options.
    "A part 3" is the connected part of A that lists call so, of several meshes of each. What is
    called both is detached, which is warned of where the same text says both. What of the settings
    is not among the selected meshes is warned of, too.
    """
    found, warnings = list[set[tuple[Side, Side]]](), list[str]()
    for name, texts in (("attach", attach), ("detach", detach)):
        pairs = set(_side_pairs(source, texts, f"--{name}"))
        for index, own in enumerate(each):
            for expression in getattr(own, name) or ():
                where = f"{source.meshes[index].path}: {name} {expression}"
                others = _sides(expression, partial(meshes_matched, source, option=where))
                pairs |= {_sorted(Side(index), other) for other in others}
                if not others:
                    warnings.append(f"{where}: {no_match(source)}")
        found.append(pairs)
    attached, detached = found
    for text in sorted(set(attach)):
        if all(_within(pair, detached) for pair in _side_pairs(source, [text], "--attach")):
            warnings.append(f"{text}: called both attached and detached: it is detached")
    left = {pair for pair in attached if not _within(pair, detached)}
    return CalledPairs(tuple(sorted(left)), tuple(sorted(detached))), warnings


def _within(pair: tuple[Side, Side], pairs: set[tuple[Side, Side]]) -> bool:
    """Whether a pair is one of several, or of parts of meshes that are."""
    each = ({side, Side(side.mesh)} for side in pair)
    return any(_sorted(one, other) in pairs for one, other in product(*each))


def _split(text: str) -> list[str]:
    """The parts between commas that are not in the braces of a predicate."""
    parts, depth = [""], 0
    for letter in text:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _with_parents(path: str) -> list[str]:
    names = path.strip("/").split("/")
    return ["/" + "/".join(names[: count + 1]) for count in range(len(names))]
