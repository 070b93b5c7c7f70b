"""Drive Blender's own window from a script: steps, one after the other, each with a picture of the window.

    blender FILE.blend -P tests/windows/SCRIPT.py -- FOLDER

A step is a function; what it returns is the number of seconds to wait before the next, None for one redraw's time.
FOLDER gets `report.json`, with what the steps recorded, and the pictures. Blender ends after the last step, with code 0
only if none raised.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import bpy

ROOT = Path(__file__).resolve().parents[2]
START_SECONDS, STEP_SECONDS = 2.0, 0.5
# What no job of these scripts takes.
WAIT_SECONDS = 240.0

Step = Callable[[], float | None]
folder = Path(sys.argv[sys.argv.index("--") + 1]).resolve() if "--" in sys.argv else Path()
record: dict[str, Any] = {}


def import_addon() -> Any:
    """Return the add-on of this tree."""
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    import addon

    return addon


def register_addon() -> None:
    """Register the add-on, and keep the splash screen away."""
    bpy.context.preferences.view.show_splash = False
    import_addon().register()


def play(steps: Iterable[Step]) -> None:
    """Run steps in Blender's main loop; each is asked for when the one before is done."""
    waiting = chain(steps, [finish])

    def tick() -> float | None:
        try:
            step = next(waiting)
            return step() or STEP_SECONDS
        except BaseException:
            traceback.print_exc()
            end(1)
            return None

    bpy.app.timers.register(tick, first_interval=START_SECONDS, persistent=True)


def finish() -> None:
    """End Blender after the last step."""
    (folder / "report.json").write_text(json.dumps(record, indent=1), encoding="utf-8")
    end(0)


def end(code: int) -> None:
    """Leave at once: quitting in the usual way would ask about unsaved changes."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def press_f12() -> None:
    """Render as a user does."""
    with within(find_area("PROPERTIES")):
        bpy.ops.render.render("INVOKE_DEFAULT")


def wait_for(kind: str = "RENDER") -> Iterator[Step]:
    """Yield steps until a job is done, as `bpy.app.is_job_running` names it; a second is left to it to begin."""
    begun = time.monotonic()
    yield lambda: 1.0
    while bpy.app.is_job_running(kind):
        if time.monotonic() > begun + WAIT_SECONDS:
            raise TimeoutError(f"{kind} did not end")
        yield lambda: None
    record["seconds"] = time.monotonic() - begun


def find_window() -> Any:
    """Return the first window; a timer has none of its own."""
    return bpy.context.window_manager.windows[0]


def find_area(kind: str, number: int = 0) -> Any:
    """Return an area of a kind, such as VIEW_3D."""
    return [area for area in find_window().screen.areas if area.type == kind][number]


def find_region(area: Any, kind: str = "WINDOW") -> Any:
    """Return a region of an area."""
    return next(region for region in area.regions if region.type == kind)


def within(area: Any, kind: str = "WINDOW") -> Any:
    """Return the context of an area, for operators."""
    return bpy.context.temp_override(window=find_window(), area=area, region=find_region(area, kind))


def show_tab(kind: str, category: str) -> tuple[Step, Step]:
    """Return two steps: open the sidebar of an area of a kind, and, once it is drawn, choose its tab."""

    def show_sidebar() -> None:
        find_area(kind).spaces.active.show_region_ui = True

    def choose_tab() -> float:
        find_region(find_area(kind), "UI").active_panel_category = category
        return 2 * STEP_SECONDS

    return show_sidebar, choose_tab


def press(kind: str, x: float, y: float) -> None:
    """Press and release a key or mouse button at a point of the window; needs `blender --enable-event-simulate`."""
    place = {"x": int(x), "y": int(y)}
    find_window().event_simulate("MOUSEMOVE", "NOTHING", **place)
    for value in ("PRESS", "RELEASE"):
        find_window().event_simulate(kind, value, **place)


def take_picture(name: str, kind: str = "") -> Step:
    """Return a step that saves the screen, or the first area of a kind, as FOLDER/NAME.png; by ImageMagick, for on a
    virtual screen Blender's own operator sees black."""

    def step() -> None:
        crop = []
        if kind:
            area, window = find_area(kind), find_window()
            top = window.height - area.y - area.height
            crop = ["-crop", f"{area.width}x{area.height}+{area.x}+{top}", "+repage"]
        subprocess.run(["import", "-window", "root", *crop, str(folder / f"{name}.png")], check=True)

    return step
