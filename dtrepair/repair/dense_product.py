"""Products of matrices in full precision."""

from __future__ import annotations

import torch
from torch import Tensor


def product(matrix: Tensor, columns: Tensor) -> Tensor:
    """matrix @ columns in full float32: TF32 would cost three digits (1e-3 of a field)."""
    precision = torch.get_float32_matmul_precision()
    if precision == "highest":
        return matrix @ columns
    torch.set_float32_matmul_precision("highest")
    try:
        return matrix @ columns
    finally:
        torch.set_float32_matmul_precision(precision)
