"""Blender add-on: finds and repairs self-intersections with dtrepair, in a process of its own.

`host` and `worker` need no bpy; `scene` and `ui` do, and load when the add-on is registered.
"""


def register() -> None:
    """Add the panel, its operators and properties to Blender."""
    from .ui import registration

    registration.register()


def unregister() -> None:
    """Take all of it back."""
    from .ui import registration

    registration.unregister()
