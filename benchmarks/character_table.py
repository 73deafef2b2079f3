"""The tables of `benchmarks.characters`: values beside their bars, a mark where one is missed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

Figures = dict[str, Any]
MISSED = " (!)"

CHARACTER_COLUMNS = (
    *("file", "parts", "frames", "real pairs", "modelled", "drift p95 / max", "edges over 4"),
    *("volume", "move max / mean", "bar of move", "jitter", "s a frame", "said"),
)
CHARACTER_BARS = (
    *("bar", "", "", "a tenth left, told", "", ".004 / .020", "5 or .05 %"),
    *("20 %", "", "3 depth + .01", "", "6, 12 over 20k", "no clean that is not"),
)
WORN_COLUMNS = (
    *("file", "frames", "worn in", "pairs", "inside (new)", "worn moved", "bar of move"),
    *("edges over 4", "jitter", "s a frame", "said"),
)
WORN_BARS = (
    *("bar", "", "all", "0 or told", "no more (0)", "", "2 depth + .01"),
    *("", "", "6", "no clean that is not"),
)


@dataclass(frozen=True)
class Cell:
    """Text of one value and whether it keeps its bar."""

    text: str
    kept: bool = True

    def __str__(self) -> str:
        """The text and the mark."""
        return self.text + ("" if self.kept else MISSED)


def move_bar(figures: Figures, factor: float) -> float:
    """What a vertex may move, over the diagonal."""
    return float(factor * max(figures["depth"], default=0.0) + 0.01)


def seconds_bar(figures: Figures) -> float:
    """Processor seconds that a frame may take."""
    return 6.0 if figures["triangles"] <= 20000 else 12.0


def character_row(name: str, figures: Figures) -> list[Cell]:
    """One row of CHARACTER_COLUMNS; a file without an output has figures of its input only."""
    before = figures["real_before"]
    start = [Cell(name), Cell(f"{figures['parts']}"), Cell(f"{figures['frames']}")]
    bar = move_bar(figures, 3.0)
    if "real_after" not in figures:
        counts = [Cell(f"{max(before)} ->"), Cell(f"{max(figures['modelled_before'])} ->")]
        blank = [Cell("")] * 4
        end = [Cell(f"{bar:.4f}"), Cell(""), _seconds(figures), Cell(figures["told"], False)]
        return [*start, *counts, *blank, *end]
    after = figures["real_after"]
    few = sum(after) <= 0.1 * sum(before) and max(after) <= 0.1 * max(before)
    p95, far = max(figures["drift_p95"]), max(figures["drift_max"])
    edges, share = max(figures["edges"]), max(figures["edges_share"])
    volume, moved = max(figures["volume"]), max(figures["move_max"])
    return [
        *start,
        Cell(f"{max(before)} -> {max(after)}", few),
        Cell(f"{max(figures['modelled_before'])} -> {max(figures['modelled_after'])}"),
        Cell(f"{p95:.4f} / {far:.3f}", p95 <= 0.004 and far <= 0.02),
        Cell(f"{edges} ({100 * share:.2f} %)", edges <= 5 or share <= 0.0005),
        Cell(f"{100 * volume:.0f} %", volume <= 0.2),
        Cell(f"{moved:.4f} / {max(figures['move_mean']):.4f}", moved <= bar),
        Cell(f"{bar:.4f}"),
        Cell(f"{figures['jitter']:.1e}"),
        _seconds(figures),
        _said(figures),
    ]


def worn_row(name: str, figures: Figures) -> list[Cell]:
    """One row of WORN_COLUMNS."""
    start, before = [Cell(name), Cell(f"{figures['frames']}")], figures["real_before"]
    bar = move_bar(figures, 2.0)
    if "real_after" not in figures:
        empty = [Cell(""), Cell(f"{max(before)} ->"), Cell(""), Cell(""), Cell(f"{bar:.4f}")]
        end = [Cell(""), Cell(""), _seconds(figures), Cell(figures["told"], False)]
        return [*start, *empty, *end]
    worn, left = figures["worn"], max(figures["real_after"])
    inside, was = figures["inside_after"], figures["inside_before"]
    fresh, moved = max(figures["inside_new"]), max(figures["worn_move"])
    more = any(now > then for now, then in zip(inside, was, strict=True))
    told = not figures["wrongly_clean"] and not figures["wrong_exit"]
    return [
        *start,
        Cell(f"{sum(worn)} of {len(worn)}", all(worn)),
        Cell(f"{max(before)} -> {left}", left == 0 or told),
        Cell(f"{max(was)} -> {max(inside)} ({fresh})", not more and fresh == 0),
        Cell(f"{moved:.4f}", moved <= bar),
        Cell(f"{bar:.4f}"),
        Cell(f"{max(figures['edges'])}"),
        Cell(f"{figures['jitter']:.1e}"),
        _seconds(figures),
        _said(figures),
    ]


def _seconds(figures: Figures) -> Cell:
    seconds = figures["seconds_per_frame"]
    return Cell(f"{seconds:.1f}", seconds <= seconds_bar(figures))


def _said(figures: Figures) -> Cell:
    wrong = figures["wrongly_clean"]
    more = f", {wrong} of them wrongly clean" if wrong else ""
    more += ", wrong exit" if figures["wrong_exit"] and not wrong else ""
    more += f", {figures['miscounted']} miscounted" if figures["miscounted"] else ""
    return Cell(figures["told"] + more, not more and figures["code"] in (0, 1))


def line(cells: list[Cell] | tuple[str, ...]) -> str:
    """A row of a Markdown table."""
    return f"| {' | '.join(str(cell) for cell in cells)} |"


def heading(columns: tuple[str, ...], bars: tuple[str, ...]) -> str:
    """Head of a table: names, then the bars of the issue as the first row."""
    return "\n".join([line(columns), "|---" * len(columns) + "|", line(bars)])
