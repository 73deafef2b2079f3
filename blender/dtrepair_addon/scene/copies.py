"""The copy of an object that carries a result; the original is hidden, and not changed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import bpy


def copied(original: Any) -> Any:
    """Return a copy of an object, with a mesh and animation of its own, beside it."""
    copy = original.copy()
    copy.data = original.data.copy()
    copy.name = f"{original.name} repaired"
    for collection in original.users_collection:
        collection.objects.link(copy)
    for own in (copy, copy.data.shape_keys):
        if own is not None and own.animation_data is not None and own.animation_data.action:
            own.animation_data.action = own.animation_data.action.copy()
    return copy


def hide(original: Any) -> None:
    """Hide an object, in the viewport and in renders."""
    original.hide_set(True)
    original.hide_render = True


def discard(copy: Any) -> None:
    """Take a copy away again, with its mesh and its actions."""
    mesh = copy.data
    animations = [own.animation_data for own in (copy, mesh.shape_keys) if own is not None]
    actions = {each.action for each in animations if each is not None and each.action is not None}
    bpy.data.objects.remove(copy)
    bpy.data.meshes.remove(mesh)
    bpy.data.batch_remove([action for action in actions if not action.users])


@contextmanager
def discarded_on_failure(copies: Iterable[Any]) -> Iterator[None]:
    """Take copies away again where what is done with them fails."""
    try:
        yield
    except BaseException:
        for copy in copies:
            discard(copy)
        raise


@contextmanager
def trial(originals: Mapping[int, Any]) -> Iterator[dict[int, Any]]:
    """Give copies of objects, by the same keys, that are gone at the end."""
    copies = {key: copied(each) for key, each in originals.items()}
    try:
        yield copies
    finally:
        for copy in copies.values():
            discard(copy)
