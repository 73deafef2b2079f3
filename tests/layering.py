"""Imports of a source tree as a graph, and what of it breaks the rules of `test_layers`."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

Graph = Mapping[str, set[str]]
# For each package its rows, top to bottom: a room, and the rooms of the package it may import.
Walls = Mapping[str, Mapping[str, str]]


def sources(root: Path, packages: Iterable[str]) -> dict[str, Path]:
    """Module names and files of the packages below a folder."""
    files = [path for package in packages for path in (root / package).rglob("*.py")]
    return {_module_name(path.relative_to(root)): path for path in sorted(files)}


def _module_name(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(path: Path) -> set[str]:
    """All names that a file imports, inside functions and for type checkers too."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name} should import by absolute names"
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def import_graph(files: Mapping[str, Path]) -> dict[str, set[str]]:
    """The modules among `files` that each module imports."""
    graph = {name: {_owner(used, files) for used in imported(files[name])} for name in files}
    return {name: used - {name, ""} for name, used in graph.items()}


def _owner(name: str, files: Mapping[str, Path]) -> str:
    """The module that holds an imported name; empty for one of another project."""
    while name and name not in files:
        name = name.rpartition(".")[0]
    return name


def circles(graph: Graph) -> list[set[str]]:
    """Groups of modules that import one another: strongly connected components of two or more."""
    names = sorted(graph)
    place = {name: index for index, name in enumerate(names)}
    ends = [(place[name], place[used]) for name in names for used in graph[name]]
    first, second = np.array(ends, dtype=np.int64).reshape(-1, 2).T
    matrix = sparse.coo_matrix((np.ones(len(ends)), (first, second)), (len(names), len(names)))
    count, labels = connected_components(matrix, directed=True, connection="strong")
    groups: list[set[str]] = [set() for _ in range(count)]
    for name, label in zip(names, labels, strict=True):
        groups[label].add(name)
    return [group for group in groups if len(group) > 1]


def arrows_up(graph: Graph, walls: Walls) -> set[str]:
    """Imports, as "package: room -> room", that the rows of the package do not allow."""
    wrong = set()
    for name, used in graph.items():
        for other in used:
            package, room, target = _rooms(name, other)
            if package in walls and target not in walls[package].get(room, "").split():
                wrong.add(f"{package}: {room} -> {target}")
    return wrong


def _rooms(name: str, other: str) -> tuple[str, str, str]:
    """The package that two modules share, and the room of each in it."""
    first, second = name.split("."), other.split(".")
    shared = 0
    while shared < min(len(first), len(second)) and first[shared] == second[shared]:
        shared += 1
    rooms = [parts[shared] if len(parts) > shared else "__init__" for parts in (first, second)]
    return ".".join(first[:shared]), rooms[0], rooms[1]


def rows_upside_down(walls: Walls) -> set[str]:
    """Rows of the table that name a room which does not stand below them."""
    wrong = set()
    for package, rows in walls.items():
        order = list(rows)
        for index, (room, allowed) in enumerate(rows.items()):
            below = order[index + 1 :]
            wrong |= {f"{package}: {room} -> {x}" for x in allowed.split() if x not in below}
    return wrong


def rows_missing_or_idle(files: Mapping[str, Path], walls: Walls) -> set[str]:
    """Rooms without a row, and rows without a room, of each package that holds packages."""
    rooms: dict[str, set[str]] = {}
    for name, path in files.items():
        package, _, room = name.rpartition(".")
        if package:
            rooms.setdefault(package, set()).add(room)
        if path.name == "__init__.py":
            rooms.setdefault(name, set())
    nested = {
        package for package in rooms if any(f"{package}.{r}" in rooms for r in rooms[package])
    }
    expected = {f"{package}.{room}" for package in nested for room in rooms[package]}
    told = {f"{package}.{room}" for package, rows in walls.items() for room in rows}
    return expected ^ {row for row in told if not row.endswith(".__init__")}
