"""Deformation transfer: source animation -> target animation (Sumner & Popovic 2004).

markers = read_markers("horse_camel.cons")
registered = register(source, source_faces, target, target_faces, markers)
pairs = match_triangles(registered, source_faces, target, target_faces)
transfer = Transfer(source, source_faces, target, target_faces, pairs)
points = transfer(poses)
report = examine(transfer, poses, points)
"""

from __future__ import annotations

from dtrepair.transfer.deformation import Transfer, transfer_blend_shapes
from dtrepair.transfer.following import FollowingOptions, following_pairs
from dtrepair.transfer.matching.alignment import Similarity, rotation_between, similarity
from dtrepair.transfer.matching.correspondence import identity_pairs, match_triangles
from dtrepair.transfer.matching.files import read_correspondence, read_markers, write_correspondence
from dtrepair.transfer.matching.marker_check import MarkerCheck, MarkerCheckOptions, check_markers
from dtrepair.transfer.matching.registration import RegistrationOptions, register
from dtrepair.transfer.pins import Pins
from dtrepair.transfer.report import (
    ConcernOptions,
    Coverage,
    TransferReport,
    examine,
    measure_coverage,
)

__all__ = [
    "ConcernOptions",
    "Coverage",
    "FollowingOptions",
    "MarkerCheck",
    "MarkerCheckOptions",
    "Pins",
    "RegistrationOptions",
    "Similarity",
    "Transfer",
    "TransferReport",
    "check_markers",
    "examine",
    "following_pairs",
    "identity_pairs",
    "match_triangles",
    "measure_coverage",
    "read_correspondence",
    "read_markers",
    "register",
    "rotation_between",
    "similarity",
    "transfer_blend_shapes",
    "write_correspondence",
]
