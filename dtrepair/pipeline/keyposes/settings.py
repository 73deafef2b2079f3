"""Everything that was chosen for key poses, as one object; what a report keeps of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypedDict

from dtrepair.keyposes.options import KeyOptions
from dtrepair.pipeline.repair.settings import RepairSettings, recorded_settings, recorded_texts
from dtrepair.pipeline.selection import ObjectOptions, PrimTable, Selection, object_of
from dtrepair.repair.options import RepairOptions


@dataclass(frozen=True, kw_only=True)
class KeyposeSettings:
    """What the result of a run over key poses depends on, besides its input and the device.

    Args:
        selection: which meshes and keys take part.
        keys: how the in-betweens are looked at and mended.
        options: of the method.
        objects: how single meshes take part.
        tables: settings of single meshes; they win over the options and what the stage holds.
        rest: the rest pose, as `RepairSettings` takes it.
    """

    selection: Selection = field(default_factory=Selection)
    keys: KeyOptions = field(default_factory=KeyOptions)
    options: RepairOptions = field(default_factory=RepairOptions)
    objects: ObjectOptions = field(default_factory=ObjectOptions)
    tables: tuple[PrimTable, ...] = ()
    rest: str | None = None

    @property
    def recorded(self) -> dict[str, Any]:
        """What an output and a report keep of the choices, as long as the input is not read."""
        more = {"rest": self.rest, "tables": recorded_texts(self.tables), **vars(self.keys)}
        return recorded_settings(self.selection, self.objects, self.options, more)

    @classmethod
    def from_report(cls, settings: Mapping[str, Any]) -> KeyposeSettings:
        """Return the settings of a run whose report has these `settings`."""
        names = vars(KeyOptions()).keys()
        other = {name: value for name, value in settings.items() if name not in names}
        common = RepairSettings.from_report(other)
        return cls(
            selection=common.selection,
            keys=object_of(KeyOptions, settings),
            options=common.options,
            objects=common.objects,
            tables=common.tables,
            rest=settings.get("rest"),
        )


class KeyposeChoices(TypedDict, total=False):
    """The fields of `KeyposeSettings`, each of which may be given by name."""

    selection: Selection
    keys: KeyOptions
    options: RepairOptions
    objects: ObjectOptions
    tables: tuple[PrimTable, ...]
    rest: str | None
