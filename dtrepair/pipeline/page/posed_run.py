"""The poses that a report speaks of: its input and its output, opened as the run had them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import InputError
from dtrepair.pipeline.modelled.references import modelled_parts
from dtrepair.pipeline.selection import CALLED, Selection, asking, object_of, recorded_tables
from dtrepair.pipeline.stages.matching import called_pairs, ignored_pairs
from dtrepair.pipeline.stages.object_settings import read_settings
from dtrepair.pipeline.stages.sources import Source, open_source
from dtrepair.pipeline.stages.world_mesh import WorldScene


@dataclass(frozen=True)
class PosedRun:
    """The scenes of a run by what they are called: "before" and "after", or one of them.

    Args:
        scenes: By name, in order; a transfer has "transferred" only.
        times: Time code (T,) of each frame of the report that has counts; NaN is the default time.
        numbers: Number (T,) of each of them among the frames of the report.
    """

    scenes: Mapping[str, WorldScene]
    times: NDArray[np.float64]
    numbers: tuple[int, ...]

    @property
    def first(self) -> WorldScene:
        """The scene that stands for the triangles of all."""
        return next(iter(self.scenes.values()))


def with_found_files(report: Mapping[str, Any], beside: str | None = None) -> dict[str, Any]:
    """Return the report with its input and output as they are found from here.

    beside: a folder to look into as well, that of the report.
    """

    def found(path: str) -> str:
        places = [report.get("folder", ""), ""]
        paths = [os.path.join(place, path) for place in places]
        if beside is not None:
            paths += [os.path.join(beside, path), os.path.join(beside, os.path.basename(path))]
        return next((there for there in paths if os.path.exists(there)), path)

    files = {name: report[name] and found(report[name]) for name in ("input", "output")}
    return {**report, **files}


def open_run(report: Mapping[str, Any]) -> PosedRun:
    """Open the input and the output of a report. Raises PipelineError where that fails.

    Of a transfer only the output shows the mesh that was moved; offsets alone pose nothing.
    """
    settings = report["settings"]
    if "transfer" in report:
        target = report["transfer"]["target"]
        chosen = Selection(prim=target if target.startswith("/") else None)
        sources = {"transferred": open_source(report["output"], chosen)}
    else:
        names = {field.name for field in fields(Selection)} - {"frames"}
        chosen = object_of(Selection, {k: v for k, v in settings.items() if k in names})
        after = None if settings.get("delta") else report["output"]
        sources = {
            when: open_source(path, chosen, collider=settings.get("collider"))
            for when, path in (("before", report["input"]), ("after", after))
            if path
        }
    scenes = _scenes(sources, settings)
    if len({(len(scene.objects), len(scene.source.meshes)) for scene in scenes.values()}) > 1:
        raise InputError(f"{report['output']}: has other meshes than {report['input']}")
    usable = [k for k, frame in enumerate(report["frames"]) if frame["before"] is not None]
    times = [report["frames"][k]["time"] for k in usable]
    return PosedRun(scenes, np.array([math.nan if t is None else t for t in times]), tuple(usable))


def _scenes(sources: Mapping[str, Source], settings: Mapping[str, Any]) -> dict[str, WorldScene]:
    """The scenes, without contacts that the run left out, or that were modelled."""
    first = next(iter(sources.values()))
    ignored = ignored_pairs(first, settings.get("ignore", ()))
    attachments = None
    if "before" in sources:
        own = read_settings(
            first, tables=asking(recorded_tables(settings), CALLED), keys=CALLED
        ).each
        asked = {key: settings.get(key, ()) for key in CALLED}
        told, _ = called_pairs(first, own, **asked)
        auto = settings.get("rest_contacts", "auto") == "auto"
        modelled = modelled_parts(first, ignored=ignored, told=told, auto=auto)
        attachments = modelled.attachments
    mode = settings.get("mode", "both")
    return {
        name: WorldScene(source, mode=mode, ignored=ignored, attachments=attachments)
        for name, source in sources.items()
    }
