"""Run the add-on's tests inside a Blender application instead of the bpy module.

    blender -b --factory-startup -P tests/run_in_blender.py -- FOLDER [PYTEST ARGUMENTS]

FOLDER holds pytest and what the tests import beside it (`pip install --target FOLDER pytest`, by a
Python of the application's version); NumPy is Blender's own. Tests that start a second Python with bpy stay outside:
by default all of tests/addon but the command line's and the package's run.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = ("commands/test_command_line.py", "test_package.py")


def main(folder: str, arguments: list[str]) -> int:
    """Run pytest with the modules in `folder`; return its exit code."""
    sys.path[:0] = [str(ROOT)]
    sys.path.append(str(Path(folder).resolve()))  # last: what Blender brings comes first
    os.chdir(ROOT)
    import pytest

    ignored = [f"--ignore=tests/addon/{name}" for name in OUTSIDE]
    return int(pytest.main(["-p", "no:cacheprovider", *(arguments or ["tests/addon", *ignored])]))


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else []
    if not given:
        sys.exit("run_in_blender: expected -- FOLDER [PYTEST ARGUMENTS]")
    code = main(given[0], given[1:])
    sys.stdout.flush()
    os._exit(code)  # Blender would end with 0
