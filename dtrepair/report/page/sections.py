"""Tables of a transfer, and of the poses between keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dtrepair.report.page.table import html_table, rounded


def transfer_table(section: Mapping[str, Any] | None) -> str:
    """Coverage, residuals and markers of a transfer."""
    if section is None:
        return ""
    markers = section["markers"] or {}
    suspects = ", ".join(str(index) for index in markers.get("suspects", ())) or "none"
    values = {
        "triangle pairs": section["pairs"],
        "paired by": section["correspondence"],
        "target triangles without a partner": section["unmatched"],
        "largest patch of them": section["largest_hole"],
        "part of the source's triangles used": f"{section['source_used']:.1%}",
        "scale of the travel": f"{section['root_scale']:.3g}",
        "residual, median": rounded(section["residual_median"]),
        "residual, 95 % below": rounded(section["residual_p95"]),
        "triangles inside out, worst frame": rounded(section["inside_out"]),
        "size of the poses over the rest": rounded(section["unit_ratio"]),
        "degrees between the rests": rounded(section["turn_degrees"]),
    }
    if markers:
        values |= {
            "markers": markers["count"],
            "marker distance, median and largest": f"{markers['distance_median']:.1%}, "
            f"{markers['distance_max']:.1%}",
            "markers to look at": suspects,
        }
    rows = [[str(value), name] for name, value in values.items()]
    return "<h2>Transfer</h2>" + html_table(["", "of the transfer"], rows)


def keyposes_table(section: Mapping[str, Any] | None, *, checked: bool = False) -> str:
    """Each span between keys: its samples, those that intersect, keys that were added.

    checked: whether nothing was repaired.
    """
    if section is None:
        return ""
    rows = []
    for span in section["spans"]:
        before, after = span["before"], span["after"]
        added, left = (
            ", ".join(f"{time:.10g}" for time in span[name]) for name in ("added", "left")
        )
        counts = [before["samples"], before["dirty"], after["dirty"], before["pairs"]]
        numbers = [str(number) for number in (*counts, after["pairs"])]
        label = f"{span['start']:.10g} to {span['end']:.10g}"
        rows.append([*numbers, added, left, label])
    # Keys are repaired first: of the input more may intersect.
    header = ["samples", "intersect with repaired keys", "in the output"]
    header += ["pairs with repaired keys", "in the output", "keys added", "left", "span"]
    if checked:
        header = ["samples", "intersect", "pairs", "where", "span"]
        rows = [[row[k] for k in (0, 1, 3, 6, 7)] for row in rows]
    table = html_table(header, rows)
    return f"<h2>Between the keys</h2><p>As USD interpolates: {section['interpolation']}</p>{table}"
