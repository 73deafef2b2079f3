"""Everything that was chosen for a repair, as one object; what a report keeps of it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, TypedDict

from dtrepair.pipeline.errors import UsageError
from dtrepair.pipeline.selection import (
    ObjectOptions,
    ObjectSettings,
    PrimTable,
    Selection,
    object_of,
    recorded_tables,
    refuse_unknown,
    table_values,
)
from dtrepair.repair.options import RepairOptions

# What can be done with the normals of meshes whose points change.
NORMALS = ("recompute", "keep", "drop")


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """What a repair of a stage writes over it, instead of the points of every frame.

    Args:
        shapes: blend shapes on the rig, with weights over time; skinned meshes stay bound.
        delta: the offsets alone, as primvar dtrepair:offset.
        normals: of meshes whose points change: "recompute" makes them follow the points, "keep"
            leaves those of the input, but for skinned meshes, "drop" blocks them.
        only_frames: write the chosen frames alone; others hold the nearest of them. Else all
            samples of a mesh that is changed are written, those not chosen as they were.

    Raises:
        UsageError: an unknown way with normals, or something without effect.
    """

    shapes: bool = False
    delta: bool = False
    normals: str = "recompute"
    only_frames: bool = False

    def __post_init__(self) -> None:
        """Refuse what cannot be together."""
        if self.normals not in NORMALS:
            raise UsageError(
                f"--normals: expected one of {', '.join(NORMALS)}, got {self.normals!r}"
            )
        if self.shapes and self.delta:
            raise UsageError("--delta: not with --shapes; leave one out")
        if self.shapes or self.delta:
            form = "--shapes" if self.shapes else "--delta"
            for option, given in (
                ("--normals", self.normals != "recompute"),
                ("--only-frames", self.only_frames),
            ):
                if given:
                    raise UsageError(f"{option}: has no effect with {form}; leave it out")

    @property
    def given(self) -> dict[str, Any]:
        """What differs from the defaults, by name."""
        default = OutputOptions()
        return {n: v for n, v in vars(self).items() if v != getattr(default, n)}


@dataclass(frozen=True, kw_only=True)
class RepairSettings:
    """What the result of a repair depends on, besides its input and the device.

    Args:
        selection: which meshes and frames take part.
        options: of the method.
        objects: how single meshes take part.
        tables: settings of single meshes; they win over the options and what the stage holds.
        rest: the rest pose: a time code of the input, "default", or the path of a stage or mesh
            file; None: the points at the default time, else the frame with fewest intersections.
        alone: repair each frame for itself, not steady in time; the published method always does.
        chunk: "K/N": part K of N of the frames; `join_layers` gives what one run would have given.
        writing: what is written.

    Raises:
        UsageError: a malformed chunk, or something that the published method has no use for.
    """

    selection: Selection = field(default_factory=Selection)
    options: RepairOptions = field(default_factory=RepairOptions)
    objects: ObjectOptions = field(default_factory=ObjectOptions)
    tables: tuple[PrimTable, ...] = ()
    rest: str | None = None
    alone: bool = False
    chunk: str | None = None
    writing: OutputOptions = field(default_factory=OutputOptions)

    def __post_init__(self) -> None:
        """Refuse what makes no sense."""
        parse_chunk(self.chunk)
        if self.chunk is not None and (self.writing.shapes or self.writing.delta):
            raise UsageError("--chunk: not with --shapes or --delta, which need all frames")
        refuse_what_paper_lacks(self.options, self.objects)

    @property
    def single(self) -> bool:
        """Whether each frame is repaired for itself: the published method knows single poses."""
        return self.alone or self.options.method == "paper"

    @property
    def recorded(self) -> dict[str, Any]:
        """What an output and a report keep of the choices, as long as the input is not read."""
        more = {
            "rest": self.rest,
            "chunk": self.chunk,
            "alone": self.alone or None,
            "tables": recorded_texts(self.tables),
            **self.writing.given,
        }
        return recorded_settings(self.selection, self.objects, self.options, more)

    @classmethod
    def from_report(cls, settings: Mapping[str, Any]) -> RepairSettings:
        """Return the settings of a run whose report has these `settings`.

        Raises UsageError for a name that no setting has.
        """
        own = ("alone", "chunk", "rest", "rest_option", "objects", "tables")
        refuse_unknown(settings, (Selection, RepairOptions, ObjectOptions, OutputOptions), own)
        return cls(
            selection=object_of(Selection, settings),
            options=object_of(RepairOptions, settings),
            objects=object_of(ObjectOptions, settings),
            tables=tables_of_texts(settings.get("tables", ())) or recorded_tables(settings),
            rest=settings.get("rest_option"),
            alone=settings.get("alone", False),
            chunk=settings.get("chunk"),
            writing=object_of(OutputOptions, settings),
        )


class RepairChoices(TypedDict, total=False):
    """The fields of `RepairSettings`, each of which may be given by name."""

    selection: Selection
    options: RepairOptions
    objects: ObjectOptions
    tables: tuple[PrimTable, ...]
    rest: str | None
    alone: bool
    chunk: str | None
    writing: OutputOptions


def recorded_settings(
    selection: Selection, objects: ObjectOptions, options: RepairOptions, more: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what an output and a report keep of the choices of a run."""
    chosen = {**selection.recorded, **asdict(options), **vars(objects), **more}
    return {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in chosen.items()
        if value is not None
    }


def recorded_texts(tables: Sequence[PrimTable]) -> list[str] | None:
    """Return tables in their order, each as JSON; None for no table.

    Of two that match a mesh the last counts, so that their order matters. Those that come of a
    report, as `recorded_tables` reads them, are what the meshes had: nobody wrote them as tables.
    """
    asked = [own for own in tables if own.origin != own.path]
    return [json.dumps({"path": own.path, **table_values(own)}) for own in asked] or None


def tables_of_texts(texts: Iterable[str]) -> tuple[PrimTable, ...]:
    """Return the tables of which `recorded_texts` made texts."""
    values = [json.loads(text) for text in texts]
    return tuple(PrimTable(own["path"], object_of(ObjectSettings, own)) for own in values)


def refuse_what_paper_lacks(options: RepairOptions | None, objects: ObjectOptions) -> None:
    """Refuse what is asked of single meshes, and the published method has no use for."""
    if options is None or options.method != "paper":
        return
    for name in ("attach", "detach", "layer", "rigid"):
        if getattr(objects, name):
            raise UsageError(f"--{name}: has no effect with --method paper; leave it out")


def parse_chunk(text: str | None) -> tuple[int, int] | None:
    """K and N of `K/N`; a usage error for anything else."""
    if text is None:
        return None
    number, slash, count = text.partition("/")
    if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise UsageError(f"--chunk {text}: expected K/N with K from 1 to N, such as 2/8")
    return int(number), int(count)
