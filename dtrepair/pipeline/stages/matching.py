"""Which meshes of an input an option or a table speaks of: a path expression, or a prim above."""

from __future__ import annotations

from collections.abc import Sequence

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.stages.sources import Source, StageSource


def matching_meshes(source: Source, expression: str, option: str) -> list[int]:
    """Indices of the selected meshes that a path expression matches, or a prim above them.

    A usage error that names `option` if there is none.
    """
    if not isinstance(source, StageSource):
        raise UsageError(f"{option}: only for USD stages; leave it out")
    from usd_io import SelectionError
    from usd_io.read.select import matching_paths

    try:
        paths = matching_paths(source.opened.stage, expression.strip())
    except SelectionError as error:
        raise UsageError(f"{option}: {error}") from None
    matched = {str(path) for path in paths}
    found = [
        index
        for index, mesh in enumerate(source.meshes)
        if any(above in matched for above in _with_parents(mesh.path))
    ]
    if not found:
        known = ", ".join(mesh.path for mesh in source.meshes[:3])
        more = " ..." if len(source.meshes) > 3 else ""
        raise UsageError(f"{option}: matches none of the selected meshes ({known}{more})")
    return found


def ignored_pairs(source: Source, texts: Sequence[str]) -> tuple[tuple[int, int], ...]:
    """Pairs of meshes (i, j), i <= j, that texts "A,B" name; each side may match several.

    "A,A" are the contacts of each mesh of A with itself and the others of A.
    """
    pairs = set()
    for text in texts:
        sides = _split(text)
        option = f"--ignore {text}"
        if len(sides) != 2 or not all(side.strip() for side in sides):
            raise UsageError(f'{option}: expected two prims, such as "/Hero/Hair,/Hero/Body"')
        first, second = (matching_meshes(source, side, option) for side in sides)
        pairs |= {(min(i, j), max(i, j)) for i in first for j in second}
    return tuple(sorted(pairs))


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
