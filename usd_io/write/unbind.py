"""Taking a mesh off its skeleton where its posed points are written."""

from __future__ import annotations

from pxr import Sdf


def unbind(layer: Sdf.Layer, path: Sdf.Path) -> None:
    """Take a mesh off its skeleton in a layer, so that clients do not deform it twice.

    Only the API schema goes; blocked joint indices would make skinning queries raise.
    """
    removed = Sdf.TokenListOp()
    removed.deletedItems = ["SkelBindingAPI"]
    Sdf.CreatePrimInLayer(layer, path).SetInfo("apiSchemas", removed)


def unbound_warnings(paths: list[str]) -> list[str]:
    """Return a warning about the meshes that a layer unbinds; none without any."""
    if not paths:
        return []
    more = f" and {len(paths) - 1} more" if paths[1:] else ""
    return [
        f"{paths[0]}{more}: posed by a skeleton or blend shapes; the layer holds the posed points, "
        "and unbinds them"
    ]
