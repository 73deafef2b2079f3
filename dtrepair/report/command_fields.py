"""What the fields mean that reports of transfers and of key poses have besides."""

from __future__ import annotations

# As in `fields`.
COMMAND_SECTIONS: dict[str, tuple[str, str, dict[str, str]]] = {
    "Transfer": (
        "transfer",
        "What a transfer is worth; figures of frames are null where none was usable.",
        {
            "correspondence": "Where the pairs come from: topology, markers or file.",
            "target": "The mesh that was moved.",
            "pairs": "Pairs of triangles of source and target.",
            "unmatched": "Target triangles without a partner.",
            "unmatched_area": "Their fraction of the target's area.",
            "largest_hole": "Triangles of their largest connected patch.",
            "source_used": "Fraction of the source's triangles that are in a pair.",
            "root_scale": "Scale of the travel.",
            "residual_median": "Median of how far triangles are from what the source's do; no "
            "unit.",
            "residual_p95": "What 95 % of these residuals lie below.",
            "residual_max": "The largest of them.",
            "inside_out": "Fraction of triangles turned inside out, in the worst frame.",
            "unit_ratio": "Size of the poses over that of the source's rest.",
            "turn_degrees": "Angle between both rests.",
            "rest_error": "The source's rest, transferred, against the target's, as a fraction of "
            "its size.",
            "markers": "How well markers agree; null without markers.",
        },
    ),
    "Markers": (
        "transfer.markers",
        "How well markers agree with each other.",
        {
            "count": "How many there are.",
            "distance_median": "Distance from where the others put a marker, as a fraction of the "
            "target's size.",
            "distance_max": "The largest of these distances.",
            "suspects": "Markers to look at.",
            "swapped": "Pairs of suspects that sit where the other belongs.",
        },
    ),
    "Poses between keys": (
        "keyposes",
        "What became of the in-betweens.",
        {
            "interpolation": "How keys are interpolated.",
            "skipped": "Spans with a key that cannot be used.",
            "spans": "The spans between neighbouring keys.",
        },
    ),
    "Span": (
        "keyposes.spans[]",
        "The in-betweens from one given key to the next.",
        {
            "start": "Time code of the first key.",
            "end": "Time code of the second.",
            "before": "As the repaired keys interpolate them, before in-betweens are mended; "
            "with `--verify-only` as the input does.",
            "after": "As the output does.",
            "left": "Time codes of those that still intersect.",
            "added": "Time codes of added keys.",
        },
    ),
    "In-betweens": (
        "keyposes.spans[].before",
        "In-betweens that were looked at.",
        {
            "samples": "How many.",
            "dirty": "How many of them intersect.",
            "pairs": "Their intersecting pairs.",
        },
    ),
}
