"""The panel in the side bar of the 3D viewport."""

# Blender reads annotations that are calls, and its classes carry no types.
# mypy: allow-subclassing-any, disable-error-code="valid-type"

from typing import Any

import bpy

from .operators import _Work


class DTREPAIR_UL_contacts(bpy.types.UIList):
    """Frames and pairs that intersect; a click goes there."""

    def draw_item(
        self,
        context: Any,
        layout: Any,
        data: Any,
        item: Any,
        icon: Any,
        active_data: Any,
        active_property: Any,
        index: int,
    ) -> None:
        """Draw one contact."""
        who = item.first if item.first == item.second else f"{item.first}, {item.second}"
        row = layout.row()
        text = f"{item.frame}: {who} ({item.pairs})"
        row.operator("dtrepair.go", text=text, emboss=False).index = index


class DTREPAIR_PT_main(bpy.types.Panel):
    """Check, repair, and what was found."""

    bl_label = "dtrepair"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "dtrepair"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        layout, settings = self.layout, context.scene.dtrepair
        layout.use_property_split = True
        layout.prop(settings, "span", expand=True)
        if settings.span == "CHOSEN":
            layout.prop(settings, "frames")
        for name in ("modelled", "clearance", "alone", "result"):
            layout.prop(settings, name)
        if settings.result == "CACHE":
            layout.prop(settings, "caches")
        for name in ("colliders", "ignored", "pin", "direction"):
            layout.prop(settings, name)
        if settings.direction:
            layout.prop(settings, "towards")
        if _Work.running:
            row = layout.row()
            row.progress(factor=settings.progress, text=settings.state)
            row.operator("dtrepair.cancel", text="", icon="X")
        else:
            row = layout.row(align=True)
            row.operator("dtrepair.check")
            row.operator("dtrepair.repair")
        if len(settings.contacts):
            layout.template_list(
                "DTREPAIR_UL_contacts", "", settings, "contacts", settings, "active"
            )
            layout.operator("dtrepair.clear")
