"""A Blender of its own that carries out orders, so that the user's file gets no scene, node or image.

    blender -b --factory-startup -P child.py -- MODULE FOLDER        or        python child.py MODULE FOLDER

Each line on standard input is an order: words with tabs between them, the first its number, for the module's
`carry_out(FOLDER, number, *words)`, which reads and writes files of that number. Each answer is one line on standard
output, DONE NUMBER or FAILED NUMBER REASON, among what Blender says itself. The end of standard input is the end. This
file runs as a script, outside of its package.
"""

from __future__ import annotations

import os
import sys
import traceback
from importlib import import_module
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1]


def serve(name: str, folder: Path) -> None:
    """Do as ordered, by a module of the add-on, until nobody orders any more."""
    # Python looks for modules beside a script first.
    sys.path[:] = [entry for entry in sys.path if Path(entry).resolve() != Path(__file__).resolve().parent]
    import bpy  # noqa: F401  (before the paths: those of the bpy module hold packages for themselves)

    sys.path.insert(0, str(PACKAGE.parent))
    module = import_module(f"{PACKAGE.name}.{name}")
    for stream in (sys.stdin, sys.stdout):  # which have the system's encoding: on Windows none that knows all names
        stream.reconfigure(encoding="utf-8", errors="backslashreplace")  # type: ignore[union-attr]
    for order in sys.stdin:
        number, *words = order.rstrip("\n").split("\t")
        try:
            module.carry_out(folder, number, *words)
            answer = f"DONE {number}"
        except Exception as error:
            traceback.print_exc()
            answer = f"FAILED {number} {' '.join(str(error).split())}"
        print(f"\n{answer}", flush=True)


if __name__ == "__main__":
    serve(sys.argv[-2], Path(sys.argv[-1]))
    sys.stdout.flush()
    os._exit(0)  # nothing of this process is to be kept
