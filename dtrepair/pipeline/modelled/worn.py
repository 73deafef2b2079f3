"""What is taken as worn in an input, by the names of its connected parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from dtrepair.pipeline.modelled.names import PartNames
from dtrepair.pipeline.modelled.references import layer_poses, modelled_references
from dtrepair.pipeline.observer import Observer, WornFound
from dtrepair.pipeline.selection import ObjectSettings, PrimTable
from dtrepair.pipeline.stages.bodies import Controls, make_bodies, read_layers
from dtrepair.pipeline.stages.matching import CalledPairs
from dtrepair.pipeline.stages.object_settings import read_settings
from dtrepair.pipeline.stages.rest import choose_rests
from dtrepair.pipeline.stages.sources import Source
from dtrepair.report.parts import WornRecord

if TYPE_CHECKING:
    from dtrepair.repair.options import RepairOptions
    from dtrepair.repair.scene.scene import Scene

Pairs = tuple[tuple[int, int], ...]


def worn_records(source: Source, scene: Scene) -> tuple[WornRecord, ...]:
    """Return which parts of a scene are taken as worn over which, unless the user said it.

    What is worn takes seconds to find for many parts: to be called once where somebody needs it.
    """
    worn = scene.worn
    if not worn:
        return ()
    own = scene.enclosures
    records = PartNames(source).named(own.part_of_face, own.count)
    return tuple(WornRecord(over=records[top], under=records[under]) for top, under in worn)


def tell_worn(observer: Observer, worn: tuple[WornRecord, ...]) -> None:
    """Tell what is taken as worn, where anything is."""
    if worn:
        observer.remark(WornFound(worn))


def worn_without_repair(
    source: Source,
    options: RepairOptions,
    *,
    tables: Sequence[PrimTable] = (),
    ignored: Pairs = (),
    told: CalledPairs = CalledPairs(),
    device: str = "cpu",
) -> tuple[WornRecord, ...]:
    """Return what a repair of an input with these options would take as worn.

    tables: settings of single meshes, of which those of layers are taken.
    """
    from dtrepair.repair.scene.make_scene import make_scene

    own = [table for table in tables if table.settings.layer is not None]
    found = read_settings(source, tables=own, keys=("layer",)).each
    rests = choose_rests(source, None, device=device)
    nothing = [None] * len(source.meshes)
    controls = Controls(
        [ObjectSettings() for _ in source.meshes],
        [*nothing],
        [*nothing],
        ignored,
        told=told,
        layers=tuple(read_layers(source, found)),
    )
    scene = make_scene(
        make_bodies(source, rests, controls, mode=options.mode).bodies,
        options,
        ignored,
        modelled_references(source, rests, ignored=ignored, told=told),
        layer_poses(source, rests),
        device=device,
    )
    return worn_records(source, scene)
