"""What each field of a report means, in the order in which the schema has them."""

from __future__ import annotations

from dtrepair.report.command_fields import COMMAND_SECTIONS

_COUNTED = {"before": "Counts before the repair; null where the frame could not be used."}
_AFTERWARDS = {"after": "Counts of what is written, null like before; of `check` the same."}

# Title of a kind of object: where the first of them stands, what it is, and its fields.
SECTIONS: dict[str, tuple[str, str, dict[str, str]]] = {
    "Report": (
        "",
        "The whole file. Times are time codes, null for the default time of USD and for mesh "
        "files. Lengths that are called fractions are fractions of a `size`: the diagonal of the "
        "bounding box before the repair. Counts are exact: pairs of triangles that share no vertex "
        "and have a common point, in float32 coordinates.",
        {
            "schema": "Name and version of this format.",
            "version": "Version of the program that wrote it.",
            "command": "The command: check, repair, keyposes or transfer.",
            "input": "The stage or mesh file, as it was given.",
            "output": "What was written; null where nothing was.",
            "folder": "Where the run stood: what input and output are relative to.",
            "device": "What it computed on: cpu or cuda:N.",
            "settings": "All choices of the run, by the names of the options; a run can be "
            "repeated from them.",
            "seconds": "Time spent, by stages of the run, and in total.",
            "warnings": "What the run has warned of, each once, in the order in which it was; "
            "frames that cannot be used have a message of their own.",
            "prims": "The meshes that took part, in their order.",
            "frames": "The frames, in order.",
            "summary": "Sums over all frames.",
            "attached": "Parts whose contacts were modelled, where there are any.",
            "passing": "Parts that only pass each other in the bind pose: not taken as attached.",
            "worn": "Open parts that are taken as worn, the largest first; of `repair` and "
            "`keyposes` where anything was to repair, of `check` with `--modelled`.",
            "findings": "What a repair may still be looked at for though nothing intersects, where "
            "there is any: by kinds and meshes, with their frames; `warnings` say it in words.",
            "alone_from": "First frame from which frames could not be repaired together.",
            "transfer": "What a transfer is worth; of `transfer` only.",
            "keyposes": "The poses between keys; of `keyposes` only.",
        },
    ),
    "Mesh": (
        "prims[]",
        "A mesh of the run.",
        {
            "path": "Its prim path, or the name of the mesh file.",
            "vertices": "How many vertices it has.",
            "triangles": "How many triangles, polygons being split.",
            "rest_intersections": "Intersecting triangles of its rest pose; null where nobody "
            "looked.",
        },
    ),
    "Frame": (
        "frames[]",
        "A frame: what was found, what was done, what is left.",
        {
            "time": "Its time code.",
            "status": "How it ended: clean; strained (resolved only beyond the bounds of "
            "deformation); improved (fewer intersections, but not none); unchanged; failed (the "
            "input is kept); skipped.",
            "message": "What is left, and what may be done about it, in words.",
            **_COUNTED,
            **_AFTERWARDS,
            "iterations": "Iterations of the method; 0 where frames were solved together.",
            "seconds": "Time spent on the frame.",
            "displacement_max": "Farthest that a vertex moved, as a fraction of the size of its "
            "mesh.",
            "displacement_mean": "Mean over all vertices of that fraction.",
            "geodesic": "Largest distance along a mesh between two triangles that still intersect, "
            "as a fraction of its widest side: small where only creases are left.",
            "normal_consistency": "Mean cosine between normals before and after, by area: 1 for a "
            "motion that turns nothing.",
            "prims": "The meshes in this frame.",
            "contacts": "Of several meshes which met which.",
            "modelled": "Modelled contacts, which are no faults, by pairs of parts.",
            "faults": "Contacts that count, by pairs of parts, where there are several.",
            "left": "What the repair left, where it left something.",
            "enclosed": "What lies wholly inside what; null where nobody looked.",
            "stages": "Stages of the repair.",
        },
    ),
    "Counts": (
        "frames[].before",
        "Intersections; those that were modelled are in the last two numbers only.",
        {
            "triangles": "Triangles that intersect something.",
            "pairs": "Pairs of intersecting triangles.",
            "inter_pairs": "Pairs of two different meshes among them.",
            "modelled_triangles": "Triangles of modelled contacts.",
            "modelled_pairs": "Pairs of modelled contacts.",
        },
    ),
    "Mesh in a frame": (
        "frames[].prims[]",
        "One mesh in one frame.",
        {
            "path": "Its prim path.",
            **_COUNTED,
            **_AFTERWARDS,
            "motion": "How it was moved, of several meshes; null where it was not.",
            "size": "Diagonal of its bounding box before the repair, in stage units.",
        },
    ),
    "Motion": (
        "frames[].prims[].motion",
        "How far a repair moved one of several meshes, and what it did to its shape.",
        {
            "displacement_max": "Farthest that a vertex moved, as a fraction of the size.",
            "rigid_rms": "Root mean square of the moves of the best rigid motion, likewise.",
            "edge_distortion": "Root mean square of the logarithms of edge lengths over those of "
            "the rest.",
            "edge_change": "The same over those of the input.",
        },
    ),
    "Contact": (
        "frames[].contacts[]",
        "Pairs of triangles of two meshes, or (both the same) of one with itself.",
        {
            "first": "Path of a mesh.",
            "second": "Path of the other.",
            "before": "Intersecting pairs before the repair.",
            "after": "And after it.",
        },
    ),
    "Enclosure": (
        "frames[].enclosed[]",
        "Parts wholly inside something closed, which intersect nothing.",
        {
            "inner": "Path of the mesh that they belong to.",
            "outer": "Path of the mesh around them; the same for other parts of one mesh.",
            "parts": "How many parts.",
        },
    ),
    "Stage": (
        "frames[].stages[]",
        "A stage of the repair of a frame.",
        {
            "name": "Its name.",
            "crossings": "Intersecting pairs after it.",
            "folds": "Pairs that share one vertex and cross beyond it.",
            "distortion": "Edge change and mean displacement, which repairs lower; no unit.",
            "iterations": "Its iterations.",
            "seconds": "Its time.",
        },
    ),
    "What is left": (
        "frames[].left",
        "What a repair could not resolve, and what may be done about it.",
        {
            "contacts": "Meshes that still intersect.",
            "advice": "What may be done: names of remedies, or why nothing can be done.",
            "rest_pairs": "Pairs that the rest pose has as well and that were to stay.",
            "enclosures": "What lies inside what, and should not.",
            "too_close": "Pairs closer than the clearance.",
            "deformations": "Meshes that are much deformed.",
            "strains": "What is deformed beyond the bounds, or would have been.",
        },
    ),
    "Contact that is left": (
        "frames[].left.contacts[]",
        "Two meshes that still intersect, or one that intersects itself.",
        {
            "first": "Path of a mesh.",
            "second": "Path of the other.",
            "pairs": "Pairs of triangles.",
            "held": "How many of them are where nothing may move.",
            "rigid": "Whether it is a rigid mesh with itself.",
        },
    ),
    "Enclosure that is left": (
        "frames[].left.enclosures[]",
        "A mesh, or a part of it, wholly inside another.",
        {"inner": "Path of the inner mesh.", "outer": "Path of the outer one."},
    ),
    "Deformation": (
        "frames[].left.deformations[]",
        "A mesh that is much deformed.",
        {
            "body": "Its path.",
            "lengths": "Factor by which its edges changed.",
            "volume": "Its volume over that of the input; null where that changed little.",
        },
    ),
    "Strain": (
        "frames[].left.strains[]",
        "A measure of a part of a mesh beyond its bound.",
        {
            "body": "Path of the mesh.",
            "part": "Which of its connected parts, 1 being that with most triangles.",
            "parts": "How many parts it has.",
            "kind": "What was measured: edges (spoilt ones), drift and slide (off what it is "
            "attached to), volume, limb (volume of a piece of one), flips (a patch that turned "
            "over), worn (a ring that came off what it goes round).",
            "value": "The number; lengths as fractions of `size`, volumes of that of the part or "
            "piece; of a ring how many times less it is passed through.",
            "bound": "What it may be at most.",
            "vertex": "The vertex of the mesh where it is worst.",
            "place": "Where that is in the input.",
            "size": "Diagonal of all that was repaired together, in stage units.",
            "other": "Mesh and part that it came off, of drift; null of all else.",
        },
    ),
    "Contacts of parts": (
        "frames[].modelled",
        "Contacts by pairs of connected parts.",
        {"listed": "The pairs of parts with most.", "others": "All others in sum."},
    ),
    "Pair of parts": (
        "frames[].modelled.listed[]",
        "Two connected parts that meet; a part with itself, too.",
        {
            "first": "A part.",
            "second": "The other.",
            "counts": "Their contacts.",
            "centre": "Where they are.",
        },
    ),
    "Other pairs of parts": (
        "frames[].modelled.others",
        "Pairs of parts that are not listed.",
        {"parts": "How many pairs of parts.", "counts": "Their contacts."},
    ),
    "Counts of parts": (
        "frames[].modelled.others.counts",
        "Numbers of contacts.",
        {
            "pairs_before": "Pairs of triangles before the repair.",
            "pairs_after": "And after it.",
            "triangles_before": "Triangles in them before the repair; one that is in contacts of "
            "several pairs of parts counts with each of them.",
            "triangles_after": "And after it.",
        },
    ),
    "Part": (
        "frames[].modelled.listed[].first",
        "A connected part of a mesh.",
        {
            "path": "Path of the mesh.",
            "number": "1 for the part with most triangles, and so on; null where the mesh is one "
            "part.",
            "triangles": "How many triangles it has.",
            "centre": "Middle of its bounding box at the start of the clip, before anything "
            "deforms it; stage units, world space.",
        },
    ),
    "Attached parts": (
        "attached",
        "Pairs of parts whose contacts are taken as modelled.",
        {
            "listed": "The pairs with most contacts.",
            "others": "How many pairs are not listed.",
            "other_pairs": "Their pairs of triangles.",
        },
    ),
    "Attached pair": (
        "attached.listed[]",
        "Two parts that overlap on purpose.",
        {
            "first": "A part.",
            "second": "The other.",
            "pairs": "Pairs of triangles in the pose that shows it.",
            "pose": "That pose.",
            "centre": "Where they overlap.",
        },
    ),
    "Passing pair": (
        "passing[]",
        "Two parts that meet in the bind pose, and lie elsewhere in nearly all frames.",
        {
            "first": "A part.",
            "second": "The other.",
        },
    ),
    "Worn part": (
        "worn[]",
        "A part that goes round or lies over another, as the rest pose or clear frames show it.",
        {
            "over": "What is worn.",
            "under": "What it lies over.",
        },
    ),
    "Finding": (
        "findings[]",
        "What the corrections of a mesh do in some frames.",
        {
            "kind": "bent (it moves as a whole in the input), moved (it stands still in the "
            "input), breaks_off (frames beside these were not chosen, and it pops there), jumps "
            "(it stands out from the frames before and after, or changes sides).",
            "path": "The mesh.",
            "largest": "How far in the worst frame, as a fraction of its size.",
            "times": "The frames.",
        },
    ),
    "Summary": (
        "summary",
        "Sums over all frames.",
        {
            "frames": "How many frames.",
            "clean": "Frames that are clean.",
            "strained": "Frames that are strained.",
            "improved": "Frames with fewer intersections.",
            "unchanged": "Frames without fewer.",
            "failed": "Frames that could not be used.",
            "skipped": "Frames that were skipped.",
            "triangles_before": "Intersecting triangles before the repair.",
            "pairs_before": "Intersecting pairs.",
            "inter_pairs_before": "Pairs of two different meshes.",
            "modelled_triangles_before": "Triangles of modelled contacts.",
            "modelled_pairs_before": "Pairs of modelled contacts.",
            "triangles_after": "Intersecting triangles of what is written.",
            "pairs_after": "Intersecting pairs.",
            "inter_pairs_after": "Pairs of two different meshes.",
            "modelled_triangles_after": "Triangles of modelled contacts.",
            "modelled_pairs_after": "Pairs of modelled contacts.",
            "displacement_max": "Farthest that a vertex moved, as a fraction of the size.",
            "displacement_mean": "Mean over the frames of their means.",
            "jitter": "Root mean square of the second difference in time of the displacement, as a "
            "fraction of the size; null for fewer than three frames.",
            "contacts": "Of several meshes which met which, summed.",
            "modelled": "Modelled contacts, summed.",
            "faults": "Contacts that count, by pairs of parts, summed.",
            "too_close": "Frames that keep less than the clearance; where there are any.",
        },
    ),
    **COMMAND_SECTIONS,
}
