"""Connected components of links between numbered items."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.device import Device, start_warp
from dtrepair.numerics.geometry import IntArray


def link_labels(
    links: NDArray[np.integer], count: int, *, device: Device | None = None
) -> IntArray:
    """Return the connected component (count,) of each item under undirected links (K, 2).

    Components are numbered by their first items. device: where to look for them; default: the CPU.
    """
    items = np.arange(count, dtype=np.int32)
    root = least_linked(links, items, device or Device())
    labels: IntArray = (np.cumsum(root == items, dtype=np.int32) - 1)[root]
    return labels


def least_linked(links: NDArray[np.integer], items: IntArray, device: Device) -> IntArray:
    """Return the least item (N,) that each of `items`, the numbers 0..N-1, is linked to.

    A thread a link (Jaiganesh & Burtscher 2018, ECL-CC).
    """
    from dtrepair.intersect.topology.topology_kernels import flatten_roots, hook_roots

    warp = start_warp()
    pairs = np.ascontiguousarray(links, dtype=np.int32).reshape(-1, 2)
    roots = device.array(items, warp.int32)
    device.launch(hook_roots, len(pairs), [device.view(pairs, warp.vec2i), roots])
    device.launch(flatten_roots, len(items), [roots])
    found: IntArray = roots.numpy()
    return found
