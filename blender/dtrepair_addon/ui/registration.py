"""All classes of the add-on, added to Blender and taken back."""

import bpy

from . import operators, overlay, panel, preferences, settings

CLASSES = (
    preferences.DTREPAIR_preferences,
    settings.DTREPAIR_contact,
    settings.DTREPAIR_settings,
    operators.DTREPAIR_OT_check,
    operators.DTREPAIR_OT_repair,
    operators.DTREPAIR_OT_cancel,
    operators.DTREPAIR_OT_clear,
    operators.DTREPAIR_OT_go,
    panel.DTREPAIR_UL_contacts,
    panel.DTREPAIR_PT_main,
)


def register() -> None:
    """Add all classes, and the settings of a scene."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.dtrepair = bpy.props.PointerProperty(type=settings.DTREPAIR_settings)


def unregister() -> None:
    """Take them back."""
    overlay.hide()
    del bpy.types.Scene.dtrepair
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
