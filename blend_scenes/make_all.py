"""Rebuild every scene of this folder, and with --gallery the pictures of its README.

    python -m blend_scenes.make_all                         all .blend files (needs the bpy of Blender 4.2)
    python -m blend_scenes.make_all glass lights            two of them
    python -m blend_scenes.make_all --gallery [glass ...]   the pictures, by this project's engine

A picture is rendered through the command line, as a user would, and then written with a dithered palette of 256
colors: small enough for a repository. That needs Pillow.
"""

from __future__ import annotations

import argparse
import importlib
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import bpy

from blend_scenes import building

SCENES = building.SCENES
GALLERY = SCENES / "gallery"
GALLERY_WIDTH = 480
GALLERY_SAMPLES = 32


def list_scenes() -> list[str]:
    """Return the names of the scenes: those that have a script make_<name>.py."""
    scripts = (path.stem.removeprefix("make_") for path in SCENES.glob("make_*.py"))
    return sorted(name for name in scripts if name != "all")


def build_scene(name: str) -> None:
    """Build the scene `name` as Blender's open file."""
    importlib.import_module(f"blend_scenes.make_{name}").build()


def gallery_size(name: str) -> str:
    """Return the size of the gallery's picture of the stored scene `name`, as the command line takes it: WxH."""
    bpy.ops.wm.open_mainfile(filepath=str(SCENES / f"{name}.blend"))
    size = bpy.context.scene.render
    return f"{GALLERY_WIDTH}x{round(size.resolution_y * GALLERY_WIDTH / size.resolution_x)}"


def render_picture(name: str) -> Path:
    """Render the stored scene `name` by the command line and return the gallery's picture of it."""
    from PIL import Image

    GALLERY.mkdir(exist_ok=True)
    picture = GALLERY / f"{name}.png"
    with tempfile.TemporaryDirectory(prefix="gallery-") as folder:
        full = Path(folder) / picture.name
        options = ["-o", str(full), "--samples", str(GALLERY_SAMPLES), "--size", gallery_size(name)]
        command = [sys.executable, "-m", "addon", "render", str(SCENES / f"{name}.blend"), *options]
        subprocess.run(command, check=True, cwd=SCENES.parent)
        with Image.open(full) as image:
            colors = image.convert("RGB")
    palette = colors.quantize(256, method=Image.Quantize.MAXCOVERAGE, kmeans=2)
    colors.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG).save(picture, optimize=True)
    return picture


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line described in the module's head."""
    parser = argparse.ArgumentParser(prog="python -m blend_scenes.make_all", description="Rebuild the example scenes.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="scenes to make; none: all of them")
    parser.add_argument("--gallery", action="store_true", help="render the pictures instead of building the files")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.names) - set(list_scenes()))
    if unknown:
        parser.error(f"no such scene: {', '.join(unknown)}; there are {', '.join(list_scenes())}")
    for name in options.names or list_scenes():
        if options.gallery:
            print(render_picture(name))
        else:
            build_scene(name)
            building.save_scene(SCENES / f"{name}.blend")


if __name__ == "__main__":
    main()
