"""Stage in, layer out, for every host: the command line, an add-on, a farm worker, a script.

Nothing here prints, reads a signal or knows the command line. A host hears of a run, and ends it,
through an `Observer`; what goes wrong is a `PipelineError` with an exit code. Messages name
settings as the options of the command line do. The names load on first use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dtrepair.pipeline.check import check_stage as check_stage
    from dtrepair.pipeline.check_settings import CheckSettings as CheckSettings
    from dtrepair.pipeline.errors import Cancelled as Cancelled
    from dtrepair.pipeline.errors import InputError as InputError
    from dtrepair.pipeline.errors import OutputError as OutputError
    from dtrepair.pipeline.errors import PipelineError as PipelineError
    from dtrepair.pipeline.errors import UsageError as UsageError
    from dtrepair.pipeline.errors import WorkersError as WorkersError
    from dtrepair.pipeline.errors import exit_code as exit_code
    from dtrepair.pipeline.join import join_layers as join_layers
    from dtrepair.pipeline.keyposes.settings import KeyposeSettings as KeyposeSettings
    from dtrepair.pipeline.keyposes.stage import plan_keyposes as plan_keyposes
    from dtrepair.pipeline.keyposes.stage import repair_keyposes as repair_keyposes
    from dtrepair.pipeline.observer import CorrectionWritten as CorrectionWritten
    from dtrepair.pipeline.observer import FrameDone as FrameDone
    from dtrepair.pipeline.observer import ModelledFound as ModelledFound
    from dtrepair.pipeline.observer import Observer as Observer
    from dtrepair.pipeline.observer import PairsFound as PairsFound
    from dtrepair.pipeline.observer import PassingFound as PassingFound
    from dtrepair.pipeline.observer import ProgressKept as ProgressKept
    from dtrepair.pipeline.observer import PropsFound as PropsFound
    from dtrepair.pipeline.observer import SetsFound as SetsFound
    from dtrepair.pipeline.observer import SpansDone as SpansDone
    from dtrepair.pipeline.observer import Trouble as Trouble
    from dtrepair.pipeline.observer import WornFound as WornFound
    from dtrepair.pipeline.repair.settings import OutputOptions as OutputOptions
    from dtrepair.pipeline.repair.settings import RepairSettings as RepairSettings
    from dtrepair.pipeline.repair.stage import plan_repair as plan_repair
    from dtrepair.pipeline.repair.stage import repair_stage as repair_stage
    from dtrepair.pipeline.selection import ObjectOptions as ObjectOptions
    from dtrepair.pipeline.selection import ObjectSettings as ObjectSettings
    from dtrepair.pipeline.selection import PrimTable as PrimTable
    from dtrepair.pipeline.selection import Selection as Selection
    from dtrepair.pipeline.stages.plan import Plan as Plan
    from dtrepair.pipeline.stages.plan import PlannedMesh as PlannedMesh
    from dtrepair.pipeline.transfer.options import TransferOptions as TransferOptions
    from dtrepair.pipeline.transfer.run import plan_transfer as plan_transfer
    from dtrepair.pipeline.transfer.run import transfer_stage as transfer_stage
    from dtrepair.pipeline.transfer.settings import TransferSettings as TransferSettings

_HOMES = {
    "Cancelled": "errors",
    "CheckSettings": "check_settings",
    "CorrectionWritten": "observer",
    "FrameDone": "observer",
    "InputError": "errors",
    "KeyposeSettings": "keyposes.settings",
    "ModelledFound": "observer",
    "ObjectOptions": "selection",
    "ObjectSettings": "selection",
    "Observer": "observer",
    "OutputError": "errors",
    "OutputOptions": "repair.settings",
    "PairsFound": "observer",
    "PipelineError": "errors",
    "Plan": "stages.plan",
    "PlannedMesh": "stages.plan",
    "PrimTable": "selection",
    "ProgressKept": "observer",
    "RepairSettings": "repair.settings",
    "Selection": "selection",
    "SpansDone": "observer",
    "TransferOptions": "transfer.options",
    "TransferSettings": "transfer.settings",
    "Trouble": "observer",
    "UsageError": "errors",
    "WorkersError": "errors",
    "PassingFound": "observer",
    "PropsFound": "observer",
    "SetsFound": "observer",
    "WornFound": "observer",
    "check_stage": "check",
    "exit_code": "errors",
    "join_layers": "join",
    "plan_keyposes": "keyposes.stage",
    "plan_repair": "repair.stage",
    "plan_transfer": "transfer.run",
    "repair_keyposes": "keyposes.stage",
    "repair_stage": "repair.stage",
    "transfer_stage": "transfer.run",
}
__all__ = [
    "Cancelled",
    "CheckSettings",
    "CorrectionWritten",
    "FrameDone",
    "InputError",
    "KeyposeSettings",
    "ModelledFound",
    "ObjectOptions",
    "ObjectSettings",
    "Observer",
    "OutputError",
    "OutputOptions",
    "PairsFound",
    "PassingFound",
    "PipelineError",
    "Plan",
    "PlannedMesh",
    "PrimTable",
    "ProgressKept",
    "PropsFound",
    "RepairSettings",
    "Selection",
    "SetsFound",
    "SpansDone",
    "TransferOptions",
    "TransferSettings",
    "Trouble",
    "UsageError",
    "WorkersError",
    "WornFound",
    "check_stage",
    "exit_code",
    "join_layers",
    "plan_keyposes",
    "plan_repair",
    "plan_transfer",
    "repair_keyposes",
    "repair_stage",
    "transfer_stage",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'dtrepair.pipeline' has no attribute {name!r}")
    return getattr(import_module(f"dtrepair.pipeline.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
