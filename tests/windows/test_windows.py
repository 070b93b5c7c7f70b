"""The add-on in Blender's own window, where there is one; the scripts beside this file drive it.

BLENDER_WINDOW names the command that opens Blender with a screen, such as `blender` on a desktop, or
`xvfb-run -a -s "-screen 0 1600x1000x24" blender`. It takes ImageMagick's `import` for the pictures, which stay in the
test's temporary folder: look at them; and xdotool for the key that stops a render.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.folders import ROOT

COMMAND = shlex.split(os.environ.get("BLENDER_WINDOW", ""))
OPTIONS = ("--window-geometry", "0", "0", "1600", "1000", "--factory-startup")
SMALLEST_PICTURE = 20_000  # bytes; a black screen has fewer

pytestmark = pytest.mark.skipif(not COMMAND, reason="set BLENDER_WINDOW to a command that opens Blender's window")


def drive(script: str, folder: Path, blend: str = "still_life.blend", simulates: bool = True) -> dict[str, Any]:
    """Run a script of this folder in Blender's window; return what it recorded.

    simulates : True where the script makes events; Blender takes no others then
    """
    command = [
        *COMMAND,
        *OPTIONS,
        *(["--enable-event-simulate"] if simulates else []),
        ROOT / "blend_scenes" / blend,
        "-P",
        ROOT / "tests" / "windows" / script,
        "--",
        folder,
    ]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False, timeout=600)
    output = done.stdout + done.stderr
    assert done.returncode == 0, output
    assert "Traceback" not in output, output
    for picture in folder.glob("*.png"):
        assert picture.stat().st_size > SMALLEST_PICTURE, picture
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


def test_rays_are_picked_drawn_and_cleared(tmp_path: Path) -> None:
    report = drive("inspect_rays.py", tmp_path)
    assert report["result"] == ["FINISHED"]
    assert report["rays"][:3] == ["0 Camera: Glass ball", "1 Reflected: nothing", "1 Refracted: Glass ball"]
    assert report["picking"] == ["RUNNING_MODAL"]
    assert (report["after_escape"], report["modal_after_escape"]) == (len(report["rays"]), [])
    assert report["picked_in_picture"] == ["0 Camera: Mirror disc", "1 Reflected: Backdrop"]
    assert report["picked_in_view"] == report["after_undo"] == ["0 View: Backdrop"]
    assert report["after_load"] == [True, True]


def test_drawings_lie_over_the_picture(tmp_path: Path) -> None:
    """A black stroke of Grease Pencil, which Blender draws."""
    report = drive("drawings.py", tmp_path)
    assert report["drawing"] == "GREASEPENCIL"
    assert report["darkest_row"] < 0.01


def test_comparisons_run_beside_blender_and_leave_the_scene_alone(tmp_path: Path) -> None:
    report = drive("compare.py", tmp_path)
    assert report["after"] == report["before"]
    assert report["running"][0] is True
    assert report["cancelled"][0] is False
    for kind in ("ray_cast", "cycles"):
        assert report[kind]["kind"] == kind
        assert (report[f"{kind}_image"], report[f"{kind}_shown"]) == ([48, 32], "Raytracer Difference")
        (ours_right, ours_error, proven), _ = report[f"{kind}_worst"]
        assert ours_right
        assert ours_error <= proven
        assert report[f"{kind}_worst_rays"] >= 1
    assert report["ray_cast"]["numbers"]["ours_wrong"] == 0
    assert report["cycles"]["numbers"]["z_fail_share"] <= 0.0025


def test_all_tabs_are_drawn_and_the_addon_comes_and_goes(tmp_path: Path) -> None:
    report = drive("tabs.py", tmp_path)
    assert ["Plane", "Nothing", "no output node, the surface is black"] in report["warnings"]
    assert report["selected"] == ["Plane"]
    assert set(report["engines"]) == {"BLENDER_EEVEE"}
    before, after = report["types"]
    assert before == after


def test_a_render_shows_a_first_look_and_its_statistics_unasked(tmp_path: Path) -> None:
    report = drive("first_look.py", tmp_path)
    assert (report["engine"], report["view"]) == ("REFERENCE_RAYTRACER", "CAMERA")
    assert {"opened", "first_look", "later", "done"} == {path.stem for path in tmp_path.glob("*.png")}


def test_the_scanner_scans_and_undo_takes_it_back(tmp_path: Path) -> None:
    report = drive("scan.py", tmp_path)
    assert report["result"] == ["FINISHED"]
    name, count = report["points"]
    assert name == "Scan"
    assert count > 10_000
    assert report["after_undo"] is False


def test_bakes_lines_and_both_eyes_come_and_panels_say_what_is_missing(tmp_path: Path) -> None:
    report = drive("finish.py", tmp_path)
    assert report["bake"] == ["RUNNING_MODAL"]
    assert report["mean_Bake"] > 0.05
    assert report["warnings"] == []


def test_a_stopped_render_is_resumed_and_the_viewport_uses_all_workers(tmp_path: Path) -> None:
    report = drive("resume.py", tmp_path, simulates=False)
    assert report["could_resume_before"] is False
    samples, is_cancelled, can_resume = report["stopped"]
    assert samples < 120
    assert is_cancelled
    assert can_resume
    assert report["finished"] == [120, False, False]
    assert report["viewport_processes"] >= 2
    assert report["viewport_status"].startswith("Sample 1/1")
