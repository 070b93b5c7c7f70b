"""The process that denoises: a Blender of its own, so that the user's file gets no scene, node or image.

    blender -b --factory-startup -P child.py -- FOLDER        or        python child.py FOLDER

Each line on standard input is an order: the number of pictures' files FOLDER/NUMBER_INPUT.npy. Each answer is one line
on standard output, DONE NUMBER or FAILED NUMBER REASON, among what Blender says itself; the picture is
FOLDER/NUMBER_Done.npy. The end of standard input is the end. This file runs as a script, outside of its package.
"""

from __future__ import annotations

import os
import sys
import traceback
from importlib import import_module
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]


def serve(folder: Path) -> None:
    """Denoise as ordered, until nobody orders any more."""
    # Python looks for modules beside a script first.
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != Path(__file__).resolve().parent]
    import bpy  # noqa: F401  (before the paths: those of the bpy module hold packages for themselves)
    import numpy as np

    sys.path.insert(0, str(PACKAGE.parent))
    compositor = import_module(f"{PACKAGE.name}.denoising.compositor")
    for order in sys.stdin:
        number = order.strip()
        try:
            paths = {name: folder / f"{number}_{name}.npy" for name in compositor.INPUTS}
            pictures = {name: np.load(path) for name, path in paths.items() if path.exists()}
            done = compositor.denoise_pictures(pictures, folder / f"{number}.exr")
            np.save(folder / f"{number}_Done.npy", done)
            answer = f"DONE {number}"
        except Exception as error:
            traceback.print_exc()
            answer = f"FAILED {number} {' '.join(str(error).split())}"
        print(f"\n{answer}", flush=True)


if __name__ == "__main__":
    serve(Path(sys.argv[-1]))
    sys.stdout.flush()
    os._exit(0)  # nothing of this process is to be kept
