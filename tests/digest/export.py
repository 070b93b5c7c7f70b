"""Write the scenes of blend_scenes for machines without Blender: `python -m tests.digest.export FOLDER`.

NAME.npz is the scene, NAME.json the settings of its render. Scenes that are there already are not written again.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy

import addon
import raytracer
from addon.extract.scene import extract_scene
from addon.properties import settings_keywords
from blend_scenes.building import SCENES
from blend_scenes.make_all import list_scenes

# What the machine decides, or the digest itself.
NOT_EXPORTED = ("samples", "workers", "precision")


def export_scene(name: str, folder: Path) -> None:
    """Write one scene and its settings."""
    bpy.ops.wm.open_mainfile(filepath=str(SCENES / f"{name}.blend"), load_ui=False)
    extraction = extract_scene(bpy.context.evaluated_depsgraph_get(), set_frame=show_frame)
    settings = {key: value for key, value in settings_keywords(bpy.context.scene).items() if key not in NOT_EXPORTED}
    (folder / f"{name}.json").write_text(json.dumps(settings), encoding="utf-8")
    raytracer.save(extraction.scene, folder / f"{name}.npz")


def show_frame(frame: int, subframe: float) -> None:
    """Have the scene show another moment, for its motion."""
    bpy.context.scene.frame_set(frame, subframe=subframe)


def main(folder: Path) -> None:
    """Write the scenes that `folder` lacks."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [name for name in list_scenes() if not (folder / f"{name}.npz").exists()]
    addon.register()
    for name in missing:
        export_scene(name, folder)
    addon.unregister()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
