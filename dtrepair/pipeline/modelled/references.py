"""Poses of an input that show which contacts were modelled: its bind pose, else its frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.modelled.meshes import STILL, Look, PlacedMeshes
from dtrepair.pipeline.modelled.parts import ModelledParts
from dtrepair.pipeline.modelled.slides import slid_references
from dtrepair.pipeline.modelled.unrepaired import unrepaired
from dtrepair.pipeline.stages.matching import CalledPairs
from dtrepair.pipeline.stages.rest import Rest
from dtrepair.pipeline.stages.sources import Source
from dtrepair.wording import listed

if TYPE_CHECKING:
    from dtrepair.numerics.attachments import Reference
    from dtrepair.numerics.geometry import IntArray

BoolArray = NDArray[np.bool_]
Pairs = Sequence[tuple[int, int]]

# What becomes of contacts of which nothing tells, and what would tell.
ALL_REPAIRED = (
    "every contact is repaired; name a pose that shows what was with --rest, or call prims "
    "attached with --attach"
)
ALL_COUNTED = (
    "every contact is counted, and repair would repair it; call prims attached with --attach, or "
    "name a pose that shows what was with --rest of repair"
)


@dataclass(frozen=True, kw_only=True)
class ReferenceOptions:
    """Which frames tell where no bind pose does.

    Args:
        samples: Frames of the whole clip that are looked at for where parts meet, at most: with
            few of them a place is taken as modelled that another frame shows to be clear.
        layer_samples: Frames that are looked at for which part lies over which.
        least: With fewer of them nothing is told: a pose or two may just be bad.
        nearly_all: Two parts are attached where they meet in this share of them.
    """

    samples: int = 33
    layer_samples: int = 9
    least: int = 5
    nearly_all: float = 0.9


def modelled_references(
    source: Source,
    rests: Sequence[Rest],
    *,
    ignored: Pairs = (),
    told: CalledPairs = CalledPairs(),
    told_by_rest: bool = False,
    options: ReferenceOptions = ReferenceOptions(),
) -> list[Reference]:
    """Poses with the contacts that each of them shows as modelled, in the space of the frames.

    Meshes that one skeleton binds, or that deform from a pose at the default time, tell by their
    rests how they lie to each other. Of meshes of two skeletons, as a rider and a horse, of what is
    moved by transforms only, and of what has no rest pose, contacts of two parts in nearly all
    frames of the whole clip are modelled, but for colliders: the pose in which they have fewest
    pairs shows where.
    Where rigid parts slide in each other, as a rod in its cylinder, frames show where, too. The
    parts of a farm agree on it.

    Parts that meet in the bind pose but lie elsewhere in nearly all frames, as long hair and the
    arms of a T-pose, only pass each other there, and are not attached.

    told: pairs of meshes that the user calls attached or detached. For two parts of attached ones
    of which nothing of that tells, the frame with fewest of their pairs shows where. told_by_rest:
    the rests of meshes that do not move at all tell, too.
    """
    meshes = PlacedMeshes(source, rests, ignored=ignored, told=told)
    return _references(meshes, told_by_rest=told_by_rest, turns=True, options=options)


def _references(
    meshes: PlacedMeshes, *, told_by_rest: bool, turns: bool, options: ReferenceOptions
) -> list[Reference]:
    """Do the work of `modelled_references` for meshes that are placed.

    turns: whether joints that turn are looked for, even where nobody asked for them.
    """
    source = meshes.source
    if meshes.one_part:
        return []
    if told_by_rest:
        still = [not mesh.animated for mesh in source.meshes]
        meshes.binding[still] = STILL
    enough = frames_tell(source, options)  # else nobody needs to look
    rest = meshes.bind_look.of(meshes.tell_by_rests(meshes.bind_look.pairs))
    passing = meshes.passing(rest) if enough else np.zeros(len(rest.pairs), dtype=bool)
    known = [rest.of(~passing)._replace(bound=meshes.bound)]
    if enough and (not meshes.one_binding or (meshes.binding == "").any()):
        looks = list(meshes.looks(options.samples))
        looks = [look.of(~meshes.collide(look.pairs)) for look in looks]
        looks = [look.of(~meshes.tell_by_rests(look.pairs)) for look in looks]
        if len(looks) >= options.least:
            known += _where_fewest(looks, options.nearly_all * len(looks))
    found = [look.reference(~meshes.asked(look.pairs)) for look in known]
    if enough:
        found += slid_references(meshes, known, samples=options.samples, turns=turns)
    if passing.any():
        found.append(rest.of(passing).reference()._replace(apart=True))
    if (detached := meshes.detached()) is not None:
        found.append(detached)
    if not meshes.told.attached:
        return found
    found += [look.reference(meshes.asked(look.pairs), asked=True) for look in known]
    shown = np.concatenate([look.keys for look in known])
    looks = [
        look.of(meshes.asked(look.pairs) & ~np.isin(look.keys, shown))
        for look in meshes.looks(options.samples)
    ]
    every = (look.reference(asked=True) for look in _where_fewest(looks, 1))
    return [*found, *every]


def layer_poses(
    source: Source,
    rests: Sequence[Rest],
    *,
    options: ReferenceOptions = ReferenceOptions(),
) -> list[Reference]:
    """Poses that show which part lies over which, in the space of the frames, with all their pairs.

    The rests, unless some are frames of the clip, which need not be the same one, or several
    skeletons bind them. Where parts meet in them, frames of the whole clip tell as well: the parts
    of a farm agree on them.
    """
    meshes = PlacedMeshes(source, rests)
    if meshes.one_part:
        return []
    rest = meshes.bind_look
    shared = (not any(rest.of_frame for rest in rests) and meshes.one_binding) or len(rests) == 1
    if shared and len(rest.pairs) == 0:
        return [rest.reference()]
    looks = [look.reference() for look in meshes.looks(options.layer_samples)]
    return [rest.reference(), *looks] if shared or not looks else looks


def untold_contacts(
    source: Source,
    rests: Sequence[Rest],
    *,
    ignored: Pairs = (),
    told: CalledPairs = CalledPairs(),
    options: ReferenceOptions = ReferenceOptions(),
) -> list[str]:
    """Say which meshes have parts that meet, while nothing tells whether they were modelled so."""
    if frames_tell(source, options):
        return []
    meshes = PlacedMeshes(source, rests, ignored=ignored, told=told)
    if meshes.one_part:
        return []
    found = [look.pairs for look in meshes.looks(options.least)]
    return _untold(meshes, found, then=ALL_REPAIRED, options=options)


def untold_in_check(
    source: Source,
    found: Sequence[IntArray],
    *,
    told: CalledPairs = CalledPairs(),
    options: ReferenceOptions = ReferenceOptions(),
) -> list[str]:
    """Say the same as `untold_contacts` of pairs (K, 2) of triangles that a check has counted."""
    if frames_tell(source, options) or not any(map(len, found)):
        return []
    meshes = PlacedMeshes(source, _own_rests(source), told=told)
    return _untold(meshes, found, then=ALL_COUNTED, options=options)


def frames_tell(source: Source, options: ReferenceOptions = ReferenceOptions()) -> bool:
    """Return whether the clip has so many frames that they tell what no bind pose does."""
    return len(unrepaired(source).clip_times) >= options.least


def _untold(
    meshes: PlacedMeshes, found: Sequence[IntArray], *, then: str, options: ReferenceOptions
) -> list[str]:
    """Say which meshes have parts in pairs (K, 2) of triangles of which nothing tells."""
    pairs = np.concatenate([np.zeros((0, 2), np.int32), *found])
    first, second = meshes.part_of[pairs].T
    known = meshes.tell_by_rests(pairs) | meshes.told_of(pairs) | meshes.collide(pairs)
    pairs = pairs[(first != second) & ~known]
    met = np.unique(meshes.mesh_of[pairs]).tolist()
    if not met:
        return []
    names = listed([meshes.source.meshes[index].path for index in met])
    bound = (meshes.binding[met] != "").all()
    lacking = "bind poses of different skeletons or caches" if bound else "no bind pose"
    return [
        f"different parts of {names} meet, and with {lacking} and fewer than {options.least} "
        f"frames nothing tells whether they were modelled so: {then}"
    ]


def _own_rests(source: Source) -> list[Rest]:
    """Return the rests that meshes bring along; of those that have none some pose."""
    return [Rest(mesh.rest, "") for mesh in source.meshes]


def modelled_parts(
    source: Source,
    *,
    ignored: Pairs = (),
    told: CalledPairs = CalledPairs(),
    auto: bool = True,
    rests: Sequence[Rest] | None = None,
) -> ModelledParts:
    """What was modelled as overlapping, by the triangles of all meshes in a row, with its parts.

    By the meshes' own rests: those that have none do not need any; or by `rests`, which tell of
    meshes that do not move at all, too. told: as `modelled_references` takes them; without
    `auto` nothing else counts as modelled.
    """
    from dtrepair.numerics.attached.overlaps import find_attachments
    from dtrepair.numerics.attachments import telling

    if not (auto or told.attached or told.detached):
        return ModelledParts(source, None)
    known = rests is not None
    rests = _own_rests(source) if rests is None else rests
    meshes = PlacedMeshes(source, rests, ignored=ignored, told=told)
    if not (auto or told.attached):
        return ModelledParts(source, None)  # parts that are not there were refused
    numbers = ReferenceOptions()
    references = _references(meshes, told_by_rest=known, turns=False, options=numbers)
    references = telling(references, auto=auto)
    faces = meshes.weld[meshes.faces_outwards()]
    attachments = find_attachments(faces, len(meshes.rest), references)
    return ModelledParts(source, attachments if len(attachments.zones) else None, references)


def _where_fewest(looks: list[Look], least: float) -> list[Look]:
    """For two parts that meet in enough poses, the pose in which they have fewest pairs."""
    if not looks:
        return []
    keys, counts = zip(*(np.unique(look.keys, return_counts=True) for look in looks), strict=True)
    every, seen = np.unique(np.concatenate(keys), return_counts=True)
    every = every[seen >= least]
    fewest = np.full(len(every), np.iinfo(np.int64).max)
    where = np.zeros(len(every), dtype=np.int64)
    for index, (own, number) in enumerate(zip(keys, counts, strict=True)):
        place = np.searchsorted(own, every)
        there = np.zeros(len(every), dtype=bool)
        inside = place < len(own)
        there[inside] = own[place[inside]] == every[inside]
        fewer = there.copy()
        fewer[there] = number[place[there]] < fewest[there]
        fewest[fewer], where[fewer] = number[place[fewer]], index
    return [
        look.of(np.isin(look.keys, every[where == index]))
        for index, look in enumerate(looks)
        if (where == index).any()
    ]
