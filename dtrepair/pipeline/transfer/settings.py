"""Everything that was chosen for a transfer, as one object; what a report keeps of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, TypedDict

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.repair.settings import refuse_what_paper_lacks
from dtrepair.pipeline.selection import (
    ObjectOptions,
    PrimTable,
    Selection,
    object_of,
    recorded_tables,
    table_values,
)
from dtrepair.pipeline.transfer.options import TransferOptions
from dtrepair.repair.options import RepairOptions


@dataclass(frozen=True, kw_only=True)
class TransferSettings:
    """What the result of a transfer depends on, besides source, target and the device.

    Args:
        selection: mesh and frames of the source.
        options: how the motion is transferred.
        poses: mesh files of the source's poses, time codes 1, 2, ...; or one animated stage.
        rest: rest pose of the source, as `RepairSettings` takes it.
        repair: repair each frame like this, with the target's rest; None: leave them.
        objects: how single meshes of the target take part in that; those that never move are not
            moved by the transfer either. Pins are those of the options.
        tables: settings of single meshes of the target, for the repair.
        alone: repair each frame for itself; None: only where the poses are mesh files.

    Raises:
        UsageError: choices that do not go together.
    """

    selection: Selection = field(default_factory=Selection)
    options: TransferOptions = field(default_factory=TransferOptions)
    poses: tuple[str, ...] = ()
    rest: str | None = None
    repair: RepairOptions | None = None
    objects: ObjectOptions = field(default_factory=ObjectOptions)
    tables: tuple[PrimTable, ...] = ()
    alone: bool | None = None

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        if self.repair is None and self.alone is not None:
            raise UsageError("--alone: has no effect without --repair")
        if self.options.shapes and self.alone is False:
            raise UsageError("--together: shapes are no motion; leave it out with --shapes")
        if self.objects.pin or self.objects.direction:
            raise UsageError("objects: a transfer takes pins of its options, and no directions")
        refuse_what_paper_lacks(self.repair, self.objects)

    def recorded(self, source: str, target: str) -> dict[str, Any]:
        """Return what an output and a report keep of the choices."""
        chosen = {
            **self.selection.recorded,
            "source_path": source,
            "target_path": target,
            "poses": list(self.poses),
            "rest": self.rest,
            **vars(self.options),
            "match": list(self.options.match) or None,
            "alone": self.alone,
            "repair": self.repair is not None,
            **(asdict(self.repair) if self.repair else {}),
            **self._recorded_objects(),
        }
        return {name: value for name, value in chosen.items() if value is not None}

    @classmethod
    def unsaid(cls) -> dict[str, Any]:
        """Return what holds of choices that a record does not say, those of a repair among them."""
        return {**cls(repair=RepairOptions()).recorded("", ""), "repair": False}

    def _recorded_objects(self) -> dict[str, Any]:
        """What was asked of single meshes, where anything was."""
        asked = {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in vars(self.objects).items()
            if value
        }
        tables = {table.path: table_values(table) for table in self.tables}
        return {**asked, **({"objects": tables} if tables else {})}

    @classmethod
    def from_report(cls, settings: Mapping[str, Any]) -> TransferSettings:
        """Return the settings of a transfer whose report has these `settings`."""
        return cls(
            selection=object_of(Selection, settings),
            options=object_of(TransferOptions, settings),
            poses=tuple(settings.get("poses", ())),
            rest=settings.get("rest"),
            repair=object_of(RepairOptions, settings) if settings.get("repair") else None,
            objects=replace(object_of(ObjectOptions, settings), pin=None),
            tables=recorded_tables(settings),
            alone=settings.get("alone"),
        )


class TransferChoices(TypedDict, total=False):
    """The fields of `TransferSettings`, each of which may be given by name."""

    selection: Selection
    options: TransferOptions
    poses: tuple[str, ...]
    rest: str | None
    repair: RepairOptions | None
    objects: ObjectOptions
    tables: tuple[PrimTable, ...]
    alone: bool | None
