"""Self-intersection repair and deformation transfer for animated meshes.

The public names load on first use, so that importing the package loads no torch, warp or scipy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from dtrepair.intersect.detector import Detector, find_intersections

_HOMES = {
    "Detector": "dtrepair.intersect.detector",
    "find_intersections": "dtrepair.intersect.detector",
}
__all__ = ["Detector", "__version__", "find_intersections"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'dtrepair' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
