"""Connected components of links between numbered items."""

from __future__ import annotations

from typing import Any

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
    device = device or Device()
    items = np.arange(count, dtype=np.int32)
    pairs = np.ascontiguousarray(links, dtype=np.int32).reshape(-1, 2)
    search = roots_in_turn if device.serial else roots_at_once
    root = search(device, device.array(pairs, start_warp().vec2i), items)
    labels: IntArray = (np.cumsum(root == items, dtype=np.int32) - 1)[root]
    return labels


def roots_in_turn(device: Device, links: Any, items: IntArray) -> IntArray:
    """Return the least item (N,) that each is linked to, from `items`, their numbers: one thread.

    The least work, for a device that has one thread; see `roots_at_once`.
    """
    from dtrepair.intersect.topology.topology_kernels import link_roots

    roots = device.array(items, start_warp().int32)
    device.launch(link_roots, 1, [links, roots])
    found: IntArray = roots.numpy()
    return found


def roots_at_once(device: Device, links: Any, items: IntArray) -> IntArray:
    """Return the same by a thread a link (Jaiganesh & Burtscher 2018, ECL-CC)."""
    from dtrepair.intersect.topology.topology_kernels import flatten_roots, hook_roots

    roots = device.array(items, start_warp().int32)
    device.launch(hook_roots, len(links), [links, roots])
    device.launch(flatten_roots, len(items), [roots])
    found: IntArray = roots.numpy()
    return found
