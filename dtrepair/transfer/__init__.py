"""Deformation transfer: source animation -> target animation (Sumner & Popovic 2004)."""

from __future__ import annotations

from dtrepair.transfer.correspondence import identity_pairs, match_triangles
from dtrepair.transfer.deformation import Transfer
from dtrepair.transfer.markers import Similarity, similarity
from dtrepair.transfer.registration import register

__all__ = ["Similarity", "Transfer", "identity_pairs", "match_triangles", "register", "similarity"]
