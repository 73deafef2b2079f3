"""What the numbers of a page mean, in plain words."""

from __future__ import annotations

from html import escape

_WORDS = {
    "intersecting triangles": "Triangles that share a point with another one that is no neighbour, "
    "counted exactly on the points that are written. Before: of the input; after: of the result.",
    "pairs": "Two triangles that intersect. One triangle may be in many pairs.",
    "modelled": "Contacts that belong there: parts that overlap on purpose in the rest pose, such "
    "as a sleeve sewn to a shoulder. They are counted apart, and stay.",
    "size": "The length of the diagonal of the box round the mesh.",
    "largest move": "How far the vertex that was moved most was moved, in units of the stage, "
    "and in per cent of the size.",
    "as a whole (rms)": "How far an object was moved if it is taken for stiff.",
    "edges": "How much lengths of edges changed on average: 0.05 is five per cent.",
    "volume": "Largest change of the volume of a closed object. Where a limb was "
    "inside another, both counted; what is pressed flat loses volume.",
    "jitter": "How much the correction jumps from frame to frame: the root mean square second "
    "difference of the moves, of the size. An even motion has none.",
    "clean": "Nothing intersects but what was modelled.",
    "strained": "The correction would have bent or stretched a part beyond its bounds. Only the "
    "share within the bounds is kept, unless it was asked for at any cost.",
    "improved, unchanged": "Fewer intersections, but not none; or none could be taken away.",
    "failed": "The frame could not be used; its input is kept.",
}


def meaning() -> str:
    """Return what the numbers mean, folded up."""
    items = "".join(f"<dt>{escape(n)}</dt><dd>{escape(text)}</dd>" for n, text in _WORDS.items())
    return f"<details><summary><h2>What the numbers mean</h2></summary><dl>{items}</dl></details>"
