"""The process that reads voxels: a Blender of its own, so that the user's file gets no object and no node.

    blender -b --factory-startup -P child.py -- FOLDER        or        python child.py FOLDER

Each line on standard input is an order: a number, and the names of grids of the file FOLDER/NUMBER.vdb, after a tab
each. Each answer is one line on standard output, DONE NUMBER or FAILED NUMBER REASON, among what Blender says itself;
the grids are in FOLDER/NUMBER.npz, under their places among the names. The end of standard input is the end. This file
runs as a script, outside of its package.
"""

from __future__ import annotations

import os
import sys
import traceback
from importlib import import_module
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]


def serve(folder: Path) -> None:
    """Read as ordered, until nobody orders any more."""
    # Python looks for modules beside a script first.
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != Path(__file__).resolve().parent]
    import bpy  # noqa: F401  (before the paths: those of the bpy module hold packages for themselves)
    import numpy as np

    sys.path.insert(0, str(PACKAGE.parent))
    sampling = import_module(f"{PACKAGE.name}.voxels.sampling")
    for order in sys.stdin:
        number, *names = order.rstrip("\n").split("\t")
        try:
            grids = sampling.read_file(folder / f"{number}.vdb", names)
            arrays = {
                f"{field}_{names.index(name)}": array
                for name, grid in grids.items()
                for field, array in grid._asdict().items()
            }
            np.savez(folder / f"{number}.npz", **arrays)
            answer = f"DONE {number}"
        except Exception as error:
            traceback.print_exc()
            answer = f"FAILED {number} {' '.join(str(error).split())}"
        print(f"\n{answer}", flush=True)


if __name__ == "__main__":
    serve(Path(sys.argv[-1]))
    sys.stdout.flush()
    os._exit(0)  # nothing of this process is to be kept
