"""How often a line passes through a loop: a limb through its ring."""

from __future__ import annotations

import numpy as np

from dtrepair.numerics.geometry import FloatArray, cross

# How far the tip of what fills a loop is off its middle and its plane, about as a share of it.
UNEVEN = 0.15


def crossings(loop: FloatArray, core: FloatArray) -> int:
    """Return how often, by sign, a line of points (M, 3) passes through a loop of points (K, 3).

    The loop is filled by triangles to a tip (Möller & Trumbore 1997). That is off its middle and
    its plane: a line through the one, or with points in the other, would meet edges of what fills
    it.
    """
    way, ahead = np.diff(core, axis=0), np.roll(loop, -1, axis=0)
    uneven = 1.0 + UNEVEN * np.sin(np.arange(len(loop)) + 1.0)
    middle = uneven @ loop / uneven.sum()
    area = cross(loop - middle, ahead - middle).sum(axis=0) / 2.0
    middle += UNEVEN * area / max(float(np.sqrt(np.linalg.norm(area))), np.finfo(float).tiny)
    away = core[:-1] - middle
    first, second = loop - middle, ahead - middle
    scale = cross(way[:, None], second[None])
    one = np.einsum("mc,mkc->mk", away, scale)
    scale = np.einsum("kc,mkc->mk", first, scale)
    turned = cross(away[:, None], first[None])
    other = np.einsum("mc,mkc->mk", way, turned)
    along = np.einsum("kc,mkc->mk", second, turned)
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other, along = one / scale, other / scale, along / scale
        hit = (one >= 0.0) & (other >= 0.0) & (one + other <= 1.0) & (along >= 0.0) & (along < 1.0)
    return int(np.sign(scale[hit]).sum())
