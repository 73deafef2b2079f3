"""Self-intersection repair and deformation transfer for animated meshes.

The public names load on first use, so that importing the package loads no torch, warp or scipy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from dtrepair.diagnosis import Advice as Advice
    from dtrepair.diagnosis import Diagnosis as Diagnosis
    from dtrepair.diagnosis import Status as Status
    from dtrepair.intersect.detector import Detector as Detector
    from dtrepair.intersect.detector import find_intersections as find_intersections
    from dtrepair.repair import itself as repair
    from dtrepair.repair.options import RepairOptions as RepairOptions
    from dtrepair.repair.repairer import Repairer as Repairer
    from dtrepair.repair.repairer import SceneRepairer as SceneRepairer
    from dtrepair.repair.repairer import repair_mesh as repair_mesh
    from dtrepair.repair.result import Count as Count
    from dtrepair.repair.result import RepairResult as RepairResult
    from dtrepair.repair.result import Stage as Stage
    from dtrepair.repair.scene.bodies import Body as Body
    from dtrepair.transfer.deformation import Transfer as Transfer
    from dtrepair.transfer.matching.correspondence import match_triangles as match_triangles
    from dtrepair.transfer.matching.registration import register as register

_HOMES = {
    "Detector": "dtrepair.intersect.detector",
    "find_intersections": "dtrepair.intersect.detector",
    "Count": "dtrepair.repair.result",
    "RepairOptions": "dtrepair.repair.options",
    "RepairResult": "dtrepair.repair.result",
    "Stage": "dtrepair.repair.result",
    "Advice": "dtrepair.diagnosis",
    "Diagnosis": "dtrepair.diagnosis",
    "Status": "dtrepair.diagnosis",
    "Body": "dtrepair.repair.scene.bodies",
    "Repairer": "dtrepair.repair.repairer",
    "SceneRepairer": "dtrepair.repair.repairer",
    "repair_mesh": "dtrepair.repair.repairer",
    "Transfer": "dtrepair.transfer.deformation",
    "match_triangles": "dtrepair.transfer.matching.correspondence",
    "register": "dtrepair.transfer.matching.registration",
}
__all__ = [
    "Advice",
    "Body",
    "Count",
    "Detector",
    "Diagnosis",
    "RepairOptions",
    "RepairResult",
    "Repairer",
    "SceneRepairer",
    "Stage",
    "Status",
    "Transfer",
    "__version__",
    "find_intersections",
    "match_triangles",
    "register",
    "repair",
    "repair_mesh",
]


def __getattr__(name: str) -> Any:
    if name == "repair":
        # The package of this name answers calls.
        return import_module("dtrepair.repair")
    if name not in _HOMES:
        raise AttributeError(f"module 'dtrepair' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
