"""The archive as Blender installs it, in a Blender of its own with empty settings."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ADDON = Path(__file__).parents[1] / "dtrepair_addon"
SCRIPT = """
import sys
import bpy
from blender.tests.character import character
character(6)
bpy.data.objects["Hero"].select_set(True)
bpy.context.scene.frame_set(3)
install = bpy.ops.extensions.package_install_files
install(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
addon = bpy.context.preferences.addons["bl_ext.user_default.dtrepair_addon"]
addon.preferences.python = sys.argv[2]
assert bpy.ops.dtrepair.check() == {"FINISHED"}
print("contacts", len(bpy.context.scene.dtrepair.contacts))
"""


def test_the_archive_works_where_it_is_installed_and_the_preference_wins(tmp_path: Path) -> None:
    bare = tmp_path / "dtrepair_addon"
    shutil.copytree(ADDON, bare, ignore=shutil.ignore_patterns("__pycache__"))
    archive = shutil.make_archive(str(tmp_path / "archive"), "zip", bare)
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, archive, os.environ["DTREPAIR_PYTHON"]],
        capture_output=True,
        text=True,
        env={**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path), "DTREPAIR_PYTHON": "none"},
    )
    assert run.returncode == 0, run.stderr
    assert "contacts 1" in run.stdout
