"""Check and Repair: modal with a window, so that Blender stays usable; at once without one."""

# Blender reads annotations that are calls, and its classes carry no types.
# mypy: allow-subclassing-any, disable-error-code="valid-type"

import time
from typing import Any, ClassVar

import bpy
import numpy as np

from ..host.interpreter import NoInterpreterError
from ..host.process import WorkerError
from ..scene.jobs import Job
from ..scene.marks import clear, mark, polygons_of, triangles_of, world
from ..scene.mesh_cache import folder_of
from ..scene.roles import Roles
from ..scene.sampling import SceneError
from . import overlay
from .preferences import interpreter
from .settings import chosen_frames

# The last is what Blender raises of an object that was deleted in the meantime.
FAILURES = (NoInterpreterError, OSError, SceneError, ValueError, WorkerError, ReferenceError)
# Seconds between two looks at the worker, with a window and without.
TICK = 0.1
PAUSE = 0.02


class _Work:
    """What both have in common: the job, the timer, the way to the end."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    command = ""
    running: ClassVar[bool] = False
    report: Any
    _job: Any = None
    _timer: Any = None

    def _finish(self, context: Any) -> None:
        """Put a result into the scene."""
        raise NotImplementedError

    @classmethod
    def poll(cls, context: Any) -> bool:
        """One at a time, and in object mode."""
        return not _Work.running and context.mode == "OBJECT"

    def execute(self, context: Any) -> set[str]:
        """Wait for the result: for scripts, and without a window."""
        try:
            self._begin(context)
            while self._job.goes_on():
                time.sleep(PAUSE)
            self._finish(context)
        except FAILURES as error:
            return self._failed(context, error)
        self._end(context)
        return {"FINISHED"}

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Begin, and come back with the timer."""
        try:
            self._begin(context)
        except FAILURES as error:
            return self._failed(context, error)
        manager = context.window_manager
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Look at the worker; Esc, or the cross in the panel, cancels."""
        settings = context.scene.dtrepair
        if event.type == "ESC" or settings.state == "cancel":
            self._end(context)
            self.report({"INFO"}, "cancelled; nothing was changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            if self._job.goes_on():
                settings.state, settings.progress = self._job.progress
                _redraw(context)
                return {"PASS_THROUGH"}
            self._finish(context)
        except FAILURES as error:
            return self._failed(context, error)
        self._end(context)
        return {"FINISHED"}

    def cancel(self, context: Any) -> None:
        """Blender ends, or loads another file."""
        self._end(context)

    def _begin(self, context: Any) -> None:
        chosen = context.scene.dtrepair
        settings = {"rest_contacts": "auto" if chosen.modelled else "repair"}
        caches = None
        if self.command == "repair":
            settings |= {"clearance": chosen.clearance, "alone": chosen.alone}
            caches = folder_of(chosen.caches) if chosen.result == "CACHE" else None
        python, frames = interpreter(), chosen_frames(context.scene)
        names = ("colliders", "ignored", "pin", "direction")
        roles = Roles(**{n: getattr(chosen, n) for n in names}, towards=tuple(chosen.towards))
        selected = context.selected_objects
        self._job = Job(self.command, python, selected, frames, settings, roles, caches)
        _Work.running = True

    def _end(self, context: Any) -> None:
        if self._timer is not None:
            context.window_manager.event_timer_remove(self._timer)
            self._timer = None
        if self._job is not None:
            self._job.cancel()
        context.scene.dtrepair.state = ""
        _Work.running = False
        _redraw(context)

    def _failed(self, context: Any, error: Exception) -> set[str]:
        self._end(context)
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}

    def _warn(self) -> None:
        for text in self._job.warnings:
            self.report({"WARNING"}, text)


class DTREPAIR_OT_check(_Work, bpy.types.Operator):
    """Count what intersects, exactly, and mark it."""

    bl_idname = "dtrepair.check"
    bl_label = "Check"
    command = "check"

    def _finish(self, context: Any) -> None:
        job, objects = self._job, self._job.objects
        pairs, contacts = job.found()
        scene = context.scene
        scene.dtrepair.contacts.clear()
        for contact in contacts:
            row = scene.dtrepair.contacts.add()
            row.frame, row.pairs, row.size = contact.frame, contact.pairs, contact.size
            row.first, row.second = (objects[i].name for i in (contact.first, contact.second))
            row.centre = contact.centre
        every = np.concatenate(pairs)
        shown: dict[int, Any] = {}
        for number, (target, mesh) in enumerate(zip(objects, job.meshes, strict=True)):
            polygons = polygons_of(every, number)
            if len(target.data.polygons) == len(mesh.counts):
                mark(target, polygons) if len(polygons) else clear(target)
            for index, frame in enumerate(job.frames):
                own = triangles_of(mesh, polygons_of(pairs[index], number))
                shown.setdefault(frame, []).append(world(mesh, index)[own].reshape(-1, 3))
        overlay.show({f: np.concatenate(c).astype(np.float32) for f, c in shown.items()})
        self._warn()
        dirty = sum(len(own) > 0 for own in pairs)
        self.report({"INFO"}, f"{dirty} of {len(pairs)} frames intersect")


class DTREPAIR_OT_repair(_Work, bpy.types.Operator):
    """Repair the frames: the result is a copy with keyed shape keys, or with a mesh cache."""

    bl_idname = "dtrepair.repair"
    bl_label = "Repair"
    command = "repair"

    def _finish(self, context: Any) -> None:
        copies = self._job.apply()
        for each in copies:
            each.select_set(True)
            context.view_layer.objects.active = each
        overlay.hide()
        self._warn()
        if self._job.dirty:
            frames = ", ".join(map(str, self._job.dirty))
            self.report({"WARNING"}, f"not clean: frames {frames}; Check lists what is left")
        self.report({"INFO"}, f"{len(copies)} objects changed" if copies else "all was clean")


class DTREPAIR_OT_cancel(bpy.types.Operator):
    """End the work; the scene stays as it was."""

    bl_idname = "dtrepair.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Only while something runs."""
        return _Work.running

    def execute(self, context: Any) -> set[str]:
        """Tell the running operator."""
        context.scene.dtrepair.state = "cancel"
        return {"FINISHED"}


class DTREPAIR_OT_clear(bpy.types.Operator):
    """Take overlay, marks and list away."""

    bl_idname = "dtrepair.clear"
    bl_label = "Clear"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: Any) -> set[str]:
        """Clear all."""
        overlay.hide()
        context.scene.dtrepair.contacts.clear()
        for each in context.scene.objects:
            if each.type == "MESH":
                clear(each)
        return {"FINISHED"}


class DTREPAIR_OT_go(bpy.types.Operator):
    """Go to the frame of a contact, and look at it."""

    bl_idname = "dtrepair.go"
    bl_label = "Go to contact"
    bl_options: ClassVar[set[str]] = {"UNDO"}
    index: bpy.props.IntProperty()

    def execute(self, context: Any) -> set[str]:
        """Set the frame, and move all viewports."""
        scene = context.scene
        if not 0 <= self.index < len(scene.dtrepair.contacts):
            self.report({"ERROR"}, "no such contact; check again")
            return {"CANCELLED"}
        contact = scene.dtrepair.contacts[self.index]
        scene.dtrepair.active = self.index
        scene.frame_set(contact.frame)
        for area in context.screen.areas if context.screen else ():
            if area.type == "VIEW_3D":
                view = area.spaces.active.region_3d
                if view.view_perspective == "CAMERA":
                    view.view_perspective = "PERSP"
                view.view_location = contact.centre
                view.view_distance = max(3.0 * contact.size, 1e-3)
        return {"FINISHED"}


def _redraw(context: Any) -> None:
    for area in context.screen.areas if context.screen else ():
        area.tag_redraw()
