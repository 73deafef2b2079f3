"""Repair of self-intersections and of contacts between objects.

The package is also the function of its name: `dtrepair.repair(points, faces)` repairs one mesh.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from dtrepair.repair.options import RepairOptions
    from dtrepair.repair.result import RepairResult

    # What `dtrepair.repair` is to a type checker: a module that answers calls.
    itself: _CallablePackage


class _CallablePackage(ModuleType):
    """A package with a function's name answers calls: importing a part of it hides a function."""

    def __call__(
        self, points: Any, faces: ArrayLike, *, options: RepairOptions | None = None
    ) -> RepairResult:
        """Repair a single mesh (V, 3), (F, 3), see `dtrepair.repair_mesh`."""
        from dtrepair.repair.repairer import repair_mesh

        return repair_mesh(points, faces, options=options)


sys.modules[__name__].__class__ = _CallablePackage
