"""numpy arrays and torch tensors at the public entry points: what comes back is what came in."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

# What callers hand in and get back: a numpy array (or nested sequence), or a torch tensor.
Array = Any


def to_numpy(values: Array) -> NDArray[Any]:
    """The values as a numpy array; a torch tensor is detached and brought to the CPU."""
    if _is_tensor(values):
        return np.asarray(values.detach().cpu().numpy())
    return np.asarray(values)


def floating_type(values: NDArray[Any]) -> np.dtype[Any]:
    """float32 stays float32; everything else comes back as float64."""
    return np.dtype(np.float32) if values.dtype == np.float32 else np.dtype(np.float64)


def like(result: NDArray[Any], model: Array) -> Array:
    """The result as a tensor on the model's device if the model is one, else as it is."""
    if _is_tensor(model):
        torch = sys.modules["torch"]
        return torch.from_numpy(np.ascontiguousarray(result)).to(model.device)
    return result


def _is_tensor(values: Array) -> bool:
    # Who holds a tensor has imported torch; asking sys.modules keeps torch out of this library.
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(values, torch.Tensor)
