"""numpy arrays and torch tensors at the public entry points: what comes back is what came in."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

# What callers hand in and get back: a numpy array (or nested sequence), or a torch tensor.
Array = Any


def to_numpy(values: Array) -> NDArray[Any]:
    """Return the values as a numpy array; a torch tensor is detached and brought to the CPU."""
    if _is_tensor(values):
        return np.asarray(values.detach().cpu().numpy())
    return np.asarray(values)


def floating_type(values: NDArray[Any]) -> np.dtype[Any]:
    """Return the type of a result: float32 for float32, float64 for everything else."""
    return np.dtype(np.float32) if values.dtype == np.float32 else np.dtype(np.float64)


def like(result: NDArray[Any], model: Array) -> Array:
    """Return the result as a tensor on the model's device if the model is one, else as it is."""
    if _is_tensor(model):
        torch = sys.modules["torch"]
        return torch.from_numpy(np.ascontiguousarray(result)).to(model.device)
    return result


def _is_tensor(values: Array) -> bool:
    """Return whether values are a torch tensor, without importing torch."""
    # Who holds a tensor has imported torch; asking sys.modules keeps torch out of this library.
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(values, torch.Tensor)
