"""What the chart of a page shows: a number of each frame for each line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from dtrepair.report.page.advice import label, only_counts
from dtrepair.report.page.lengths import largest_move

Frame = Mapping[str, Any]
Values = list[float | None]


def chart_data(
    report: Mapping[str, Any], measures: Mapping[str, Sequence[float | None]]
) -> dict[str, Any]:
    """Return places and labels of the frames, the lines of the chart, a sentence for each frame.

    measures: by name a part of something for each frame; a chart has per cent.
    """
    frames = report["frames"]
    times = [frame["time"] for frame in frames]
    numbered = all(t is not None for t in times) and all(a < b for a, b in pairwise(times))
    return {
        "x": times if numbered else list(range(len(frames))),
        "numbered": numbered,
        "labels": [label(frame) for frame in frames],
        "series": [line for line in _lines(report, measures) if _says(line["values"])],
        "told": [told(frame, checked=only_counts(report)) for frame in frames],
    }


def told(frame: Frame, *, checked: bool) -> str:
    """Return a frame in a sentence; checked: whether nothing was repaired."""
    start = f"Frame {label(frame)}: "
    if frame["before"] is None or frame["after"] is None:
        return f"{start}{frame['status']}: {frame['message']}"
    before, after = frame["before"]["triangles"], frame["after"]["triangles"]
    if checked:
        return f"{start}{before} intersecting triangles"
    moved = f"moved by {largest_move(frame)} at most"
    return f"{start}{before} → {after} intersecting triangles, {moved}, {frame['status']}"


def _lines(
    report: Mapping[str, Any], measures: Mapping[str, Sequence[float | None]]
) -> list[dict[str, Any]]:
    frames = report["frames"]

    def counts(when: str, name: str) -> Values:
        return [frame[when].get(name, 0) if frame[when] else None for frame in frames]

    def marks(wanted: Callable[[Frame], bool], height: float) -> Values:
        return [height if wanted(frame) else None for frame in frames]

    def percent(values: Sequence[float | None]) -> Values:
        return [None if value is None else 100 * value for value in values]

    checked = only_counts(report)
    strained = marks(lambda frame: frame["status"] == "strained", 0.97)
    moved = [frame["displacement_max"] if frame["after"] else None for frame in frames]
    lines = [
        _line("intersecting" if checked else "before", "--before", counts("before", "triangles")),
        _line("failed", "--failed", marks(lambda f: f["before"] is None, 0.9), "mark"),
    ]
    if not checked:
        lines += [
            _line("after", "--after", counts("after", "triangles")),
            _line("strained", "--strained", strained, "mark"),
            _line("largest move", "--move", percent(moved), "percent"),
        ]
    modelled = counts("before", "modelled_triangles")
    if any(modelled):
        lines.append(_line("modelled", "--modelled", modelled, show=False))
    for name, colour in (("volume", "--volume"), ("jitter", "--jitter")):
        values = [None if v is None else abs(v) for v in measures.get(name, ())]
        title = "change of volume" if name == "volume" else name
        lines.append(_line(title, colour, percent(values), "percent", show=name == "volume"))
    return lines


def _line(
    name: str, colour: str, values: Values, scale: str = "count", *, show: bool = True
) -> dict[str, Any]:
    fill = name in ("before", "intersecting")
    line = {"name": name, "colour": colour, "values": values, "scale": scale}
    return {**line, "show": show, "fill": fill}


def _says(values: Values) -> bool:
    """Whether there is anything to see; counts of nothing after a repair are."""
    return any(value is not None for value in values)
