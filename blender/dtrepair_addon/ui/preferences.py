"""Where the Python with dtrepair is, as the artist sets it."""

# Blender reads annotations that are calls, and its classes carry no types.
# mypy: allow-subclassing-any, disable-error-code="valid-type"

from pathlib import Path
from typing import Any

import bpy

from ..host.interpreter import VARIABLE, find_interpreter

# An extension is registered under its full module name, "bl_ext.REPOSITORY.dtrepair_addon".
ADDON = __package__.rpartition(".")[0]


class DTREPAIR_preferences(bpy.types.AddonPreferences):
    """One path."""

    bl_idname = ADDON
    python: bpy.props.StringProperty(
        name="Python with dtrepair",
        description="Its virtual environment, or the interpreter itself. Empty: what the "
        f"variable {VARIABLE} names, else dtrepair/venv in your configuration folder",
        subtype="FILE_PATH",
    )

    def draw(self, context: Any) -> None:
        """Draw the path."""
        self.layout.prop(self, "python")


def interpreter() -> Path:
    """Return the Python of the worker. Raises NoInterpreterError where there is none."""
    addon = bpy.context.preferences.addons.get(ADDON)
    return find_interpreter(bpy.path.abspath(addon.preferences.python) if addon else "")
