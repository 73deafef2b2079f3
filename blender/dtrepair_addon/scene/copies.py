"""The copy of an object that carries a result; the original is hidden, and not changed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy


@dataclass(frozen=True)
class Copy:
    """A copy, its original, and whether that was hidden, in the viewport and in renders."""

    object: Any
    original: Any
    hidden: tuple[bool, bool]


def copied(original: Any) -> Copy:
    """Return a copy of an object, with a mesh and animation of its own; hide the original."""
    copy = original.copy()
    copy.data = original.data.copy()
    copy.name = f"{original.name} repaired"
    for collection in original.users_collection:
        collection.objects.link(copy)
    for own in (copy, copy.data.shape_keys):
        if own is not None and own.animation_data is not None and own.animation_data.action:
            own.animation_data.action = own.animation_data.action.copy()
    hidden = original.hide_get(), original.hide_render
    original.hide_set(True)
    original.hide_render = True
    return Copy(copy, original, hidden)


def discard(copy: Copy) -> None:
    """Take a copy away again; the original is hidden as it was."""
    mesh = copy.object.data
    bpy.data.objects.remove(copy.object)
    bpy.data.meshes.remove(mesh)
    copy.original.hide_set(copy.hidden[0])
    copy.original.hide_render = copy.hidden[1]


@contextmanager
def discarded_on_failure(copies: Iterable[Copy]) -> Iterator[None]:
    """Take copies away again where what is done with them fails."""
    try:
        yield
    except BaseException:
        for copy in copies:
            discard(copy)
        raise
