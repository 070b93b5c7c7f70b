"""The viewport in a real window: `viewport_window` drives it, and this asks what happened.

Runs where the environment variable BLENDER names a Blender application that finds a screen, which may be a virtual one
(`BLENDER` may be a script that calls `xvfb-run -a blender "$@"`). Nothing here judges how fast it is; `report.json` and
the pictures, for a person to look at, are left in the folder that VIEWPORT_REPORT names, if it names one.
"""

from __future__ import annotations

import json
import os
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

from tests.portable import is_running

BLENDER = os.environ.get("BLENDER", "")
NO_SCREEN = ("Unable to open a display", "initialization failed", "cannot open display")

# Seconds; a test that waits longer has failed.
PATIENCE = 60.0

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not BLENDER, reason="set BLENDER to a Blender application with a screen to drive its viewport"),
]


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return what the driver wrote down."""
    folder = Path(os.environ.get("VIEWPORT_REPORT") or tmp_path_factory.mktemp("viewport"))
    folder.mkdir(parents=True, exist_ok=True)
    done = subprocess.run(
        [BLENDER, "--factory-startup", "-P", str(Path(__file__).with_name("viewport_window.py")), "--", str(folder)],
        capture_output=True,
        text=True,
        timeout=1800,
    )
    output = done.stdout + done.stderr
    if any(line in output for line in NO_SCREEN):
        # Asked for by BLENDER, but there is nothing to draw on; anything else that goes wrong fails below.
        pytest.skip("Blender found no screen to open a window on")
    path = folder / "report.json"
    assert path.exists(), output
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    assert done.returncode == 0, output
    assert "error" not in found, found["error"]
    assert "Traceback" not in output, output
    return found


def test_every_step_came_to_its_end(report: dict[str, Any]) -> None:
    assert report["finished"]
    assert report["triangles"] == 500_000


def test_two_viewports_draw_at_once(report: dict[str, Any]) -> None:
    one, other = report["widths of two viewports"]
    assert one > 0
    assert other > 0


def test_a_bad_scene_is_a_sentence(report: dict[str, Any]) -> None:
    assert report["status of a bad scene"].startswith("Error: Camera 'Camera' has a scale of")


def test_no_process_stays_behind(report: dict[str, Any]) -> None:
    assert report["processes after change of engine"] == 0
    assert report["process at exit"]
    for process in report["process at exit"]:
        wait_for_end(process)


def wait_for_end(process: int) -> None:
    """Wait until a process is no more; it notices by itself that Blender has gone."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if not is_running(process):
            return
        time.sleep(0.1)
    pytest.fail(f"process {process} stayed behind")


def test_memory_does_not_grow_with_redraws(report: dict[str, Any]) -> None:
    early, late = report["memory after a fifth and all of the redraws, MB"]
    # A redraw that lost its pixels would lose some 2 MB; the allocators' own ups and downs are 2 MB in all.
    assert late - early < 0.01 * report["draws of redraw_often"]["count"]
