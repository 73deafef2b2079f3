"""Which part of the default method a moment of processor time belongs to."""

from __future__ import annotations

import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import wraps
from importlib import import_module
from types import FunctionType
from typing import Any
from unittest import mock

# The parts, where they are - a module, or functions of it - and where they run. What is called by
# a part and in none itself belongs to it; the first that names a function has it.
PARTS: list[tuple[str, str, list[str]]] = [
    ("solves of factors", "cholespy; behind `Solver`", ["numerics.operators:Factor.__call__"]),
    ("factors", "cholespy; behind `Solver`", ["numerics.operators:Factor.__init__"]),
    (
        "detection: tree and pairs",
        "device",
        ["intersect.detector:Detector", "intersect.exact:settled"],
    ),
    (
        "gaps: nearest points, facing triangles",
        "device",
        ["repair.elastic.gaps:Gaps._nearest", "repair.elastic.gaps:Gaps._faced"],
    ),
    ("rotations and edges of them", "device", ["repair.elastic.arap:ArapSystem.target"]),
    ("folds, ray crossings, vector areas", "device", ["intersect.queries:Queries"]),
    ("ring distances", "device", ["intersect.topology.ring_distances"]),
    ("components of links", "device", ["intersect.topology.components"]),
    ("winding numbers but for these", "numpy, and a kernel", ["repair.surface.winding"]),
    ("gaps: lists and matrices", "numpy, scipy", ["repair.elastic.gaps"]),
    (
        "relaxing: gradients, volume, acceptance",
        "numpy, scipy",
        [
            "repair.elastic.contact_step",
            "repair.elastic.volume_pressure",
            "repair.elastic.arap",
            "repair.full.relax",
            "repair.full.settle",
            "repair.full.acceptance",
        ],
    ),
    (
        "contacts: filters, regions",
        "numpy",
        ["repair.surface.contacts", "repair.surface.uncertain_pairs", "repair.surface.defects"],
    ),
    ("fill", "scipy: a small factor a patch", ["repair.full.biharmonic_fill"]),
    (
        "edges and creases",
        "numpy",
        [
            "repair.full.cure",
            "repair.elastic.edge_lengths",
            "repair.elastic.dihedral_angles",
            "repair.elastic.least_motion",
        ],
    ),
    ("push", "numpy", ["repair.full.push"]),
]


class Shares:
    """Processor seconds of parts: a call belongs to the innermost part that it is in."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inside, self._since = ["the rest"], time.process_time()

    def switch(self) -> None:
        """Give the time since the last switch to the part that it was spent in."""
        now = time.process_time()
        self.seconds[self._inside[-1]] += now - self._since
        self._since = now

    def watched(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """A function whose time is a part's."""

        @wraps(function)
        def watched(*arguments: Any, **named: Any) -> Any:
            self.switch()
            self._inside.append(part)
            try:
                return function(*arguments, **named)
            finally:
                self.switch()
                self._inside.pop()

        return watched

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch all functions of `PARTS`, in every module that has them, inside the block."""
        taken: dict[FunctionType, Callable[..., Any]] = {}
        with ExitStack() as stack:
            for part, _, places in PARTS:
                for owner, name, function in (f for place in places for f in functions_of(place)):
                    if function not in taken:
                        taken[function] = self.watched(part, function)
                        if isinstance(owner, type):
                            stack.enter_context(mock.patch.object(owner, name, taken[function]))
            for module in [m for n, m in sys.modules.items() if n.startswith("dtrepair")]:
                for name, value in list(vars(module).items()):
                    if isinstance(value, FunctionType) and value in taken:
                        stack.enter_context(mock.patch.object(module, name, taken[value]))
            self._since = time.process_time()
            yield


def functions_of(place: str) -> Iterable[tuple[Any, str, FunctionType]]:
    """The owner, name and function of `module`, `module:function`, `:class` or `:class.method`."""
    path, _, inside = place.partition(":")
    module = import_module(f"dtrepair.{path}")
    owner, _, method = inside.partition(".")
    of_module = (
        [owner]
        if owner
        else [n for n, v in vars(module).items() if getattr(v, "__module__", "") == module.__name__]
    )
    for name in of_module:
        value = getattr(module, name)
        if isinstance(value, FunctionType):
            yield module, name, value
        elif isinstance(value, type):
            for own in [method] if method else list(vars(value)):
                if isinstance(vars(value)[own], FunctionType):
                    yield value, own, vars(value)[own]
