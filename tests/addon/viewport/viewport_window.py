"""Drives the viewport of a Blender application in its window and writes down what happened; see test_viewport_window.

    blender --factory-startup -P tests/addon/viewport/viewport_window.py -- FOLDER [STEP ...]

FOLDER gets `report.json` and a screenshot of each scene; names of steps may follow. The steps are generators: each
`yield` lets Blender go on.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bpy

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from addon.properties import ENGINE  # noqa: E402
from addon.viewport import pool, viewport  # noqa: E402
from tests.portable import is_running, measure_work, read_memory  # noqa: E402

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
CHOSEN = sys.argv[sys.argv.index("--") + 2 :]
# Seconds after which a step is given up.
PATIENCE = 90.0
REDRAWS = 1000
report: dict[str, Any] = {}
draws: list[tuple[float, float]] = []
updates: list[float] = []


def measure(kind: type, name: str, record: Any) -> None:
    """Have `record` called with the seconds, by the clock and of this thread, that each call of a method takes."""
    method = getattr(kind, name)

    def measured(*arguments: Any) -> Any:
        wall, own = time.perf_counter(), time.thread_time()
        result = method(*arguments)
        record(time.perf_counter() - wall, time.thread_time() - own)
        return result

    setattr(kind, name, measured)


measure(viewport.Viewport, "draw", lambda wall, own: draws.append((wall, own)))
measure(viewport.Viewport, "update", lambda wall, own: updates.append(own))


def areas() -> list[Any]:
    return [area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D"]


def override(area: Any) -> Any:
    region = next(region for region in area.regions if region.type == "WINDOW")
    return bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area, region=region)


def viewports() -> list[Any]:
    return list(viewport._viewports)


def shown(one: Any) -> Any:
    """Return the picture that a viewport shows, if it belongs to what was asked last."""
    live, upload = one.session._live, one.canvas._shown
    is_current = live.report is not None and live.report.job == live._job and not live.has_news
    return upload.picture if upload is not None and is_current and not one.canvas.is_busy else None


def until(condition: Any) -> Iterator[None]:
    """Let Blender go on until a condition is met."""
    started = time.perf_counter()
    while not condition():
        if time.perf_counter() - started > PATIENCE:
            raise TimeoutError("a step of the viewport did not come to its end")
        yield


def wait(seconds: float) -> Iterator[None]:
    end = time.perf_counter() + seconds
    yield from until(lambda: time.perf_counter() > end)


def has_samples(count: int) -> bool:
    return bool(viewports()) and all(shown(one) is not None and shown(one).samples >= count for one in viewports())


def until_drawn(name: str, count: int = 1) -> Iterator[None]:
    """Wait for a picture of `count` samples in all viewports, and photograph the window."""
    yield from until(lambda: has_samples(count))
    yield
    photograph(name)
    yield


def photograph(name: str) -> None:
    """Photograph the screen, where ImageMagick is installed; Blender's own screenshot of a virtual one is black."""
    command = shutil.which("import")
    if command:
        subprocess.run([command, "-window", "root", str(FOLDER / f"{name}.png")], check=True)


def set_view(area: Any, perspective: str) -> None:
    area.spaces[0].region_3d.view_perspective = perspective
    area.spaces[0].shading.type = "RENDERED"


def time_first_picture(name: str, change: Any) -> Iterator[None]:
    """Measure the time from a change to the first picture that shows it: when it came, when it was on the screen.

    Between the two lies Blender's own redraw of its window, which on a virtual screen takes a quarter of a second.
    """
    live = viewports()[0].session._live
    job, started = live._job, time.perf_counter()
    arrived = watch_arrival(live, job)
    change()
    yield from until(lambda: live._job > job and shown(viewports()[0]) is not None)
    report[name] = {"seconds until it is on the screen": time.perf_counter() - started, **arrived(started)}


def watch_arrival(live: Any, job: int) -> Callable[[float], dict[str, float]]:
    """Look for the first report on a later job, in a thread; return what tells when it came and the work for it."""
    worked = measure_work(live.process_id)
    found: dict[str, float] = {}

    def look() -> None:
        end = time.perf_counter() + PATIENCE
        while time.perf_counter() < end and not (live.report is not None and live.report.job > job):
            time.sleep(0.002)
        found.update(clock=time.perf_counter(), work=measure_work(live.process_id) - worked)

    thread = threading.Thread(target=look, daemon=True)
    thread.start()

    def tell(started: float) -> dict[str, float]:
        thread.join()
        return {"seconds until it came": found["clock"] - started, "of the render process": found["work"]}

    return tell


def show_default_scene() -> Iterator[None]:
    bpy.context.scene.render.engine = ENGINE
    pool.prepare()
    yield from until(lambda: bool(pool._waiting))
    area = areas()[0]
    yield from wait(6.0)
    started = time.perf_counter()
    set_view(area, "CAMERA")
    yield from until(lambda: bool(viewports()) and shown(viewports()[0]) is not None)
    report["first picture, Rendered switched on"] = {"seconds until it is on the screen": time.perf_counter() - started}
    yield from until_drawn("camera")
    cube = bpy.data.objects["Cube"]
    yield from time_first_picture("first picture, object moved", lambda: setattr(cube.location, "x", 0.5))
    set_view(area, "PERSP")
    yield from until_drawn("free")
    set_view(area, "ORTHO")
    yield from until_drawn("orthographic")
    set_view(area, "PERSP")


def show_borders() -> Iterator[None]:
    area, render = areas()[0], bpy.context.scene.render
    space = area.spaces[0]
    space.use_render_border = True
    space.render_border_min_x, space.render_border_max_x = 0.25, 0.75
    space.render_border_min_y, space.render_border_max_y = 0.25, 0.6
    yield from until_drawn("border_of_region")
    space.use_render_border = False
    set_view(area, "CAMERA")
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.4, 0.8, 0.25, 0.75
    yield from until_drawn("border_of_camera")
    render.use_border = False
    render.film_transparent = True
    yield from until_drawn("transparent")
    render.film_transparent = False


def show_two_viewports() -> Iterator[None]:
    with override(areas()[0]):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.5)
    yield
    set_view(areas()[0], "CAMERA")
    set_view(areas()[1], "PERSP")
    yield from until(lambda: len(viewports()) == 2)
    yield from until_drawn("two_viewports")
    report["widths of two viewports"] = [one.canvas._shown.picture.right for one in viewports()]
    with override(areas()[1]):
        bpy.ops.screen.area_close()
    yield from until(lambda: len(viewports()) == 1)


def change_and_undo() -> Iterator[None]:
    window = bpy.context.window_manager.windows[0]
    with override(areas()[0]):
        bpy.ops.ed.undo_push(message="before")
        bpy.ops.mesh.primitive_uv_sphere_add(location=(0.0, 0.0, 1.5))
        bpy.ops.ed.undo_push(message="sphere")
    yield from until_drawn("before_undo")
    with bpy.context.temp_override(window=window):
        bpy.ops.ed.undo()
    yield from until_drawn("after_undo")
    with override(areas()[0]):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.view_layer.objects.active = bpy.data.objects["Cube"]
        bpy.ops.object.mode_set(mode="EDIT")
    yield from until_drawn("edit_mode")
    with override(areas()[0]):
        bpy.ops.object.mode_set(mode="OBJECT")
    yield


def show_error() -> Iterator[None]:
    camera = bpy.data.objects["Camera"]
    set_view(areas()[0], "CAMERA")
    camera.scale = (0.0, 0.0, 0.0)
    yield from until(lambda: viewports()[0].session.status.startswith("Error"))
    yield
    yield
    report["status of a bad scene"] = viewports()[0].session.status
    photograph("error")
    camera.scale = (1.0, 1.0, 1.0)
    yield from until_drawn("error_mended")


def leave_and_return() -> Iterator[None]:
    """Change engine and file while a picture is being drawn, and look for processes that stay behind."""
    scene, before = bpy.context.scene, {one.session._live.process_id for one in viewports()}
    scene.render.engine = "BLENDER_WORKBENCH"
    yield from until(lambda: not viewports())
    yield from until(lambda: not pool._waiting)
    report["processes after change of engine"] = sum(is_running(process) for process in before)
    scene.render.engine = ENGINE
    yield from until_drawn("engine_again")
    path = FOLDER / "saved.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    yield
    bpy.ops.wm.open_mainfile(filepath=str(path))
    yield from until(lambda: not viewports())
    set_view(areas()[0], "CAMERA")  # Blender loads no file with Rendered switched on
    yield from until_drawn("file_again")


def redraw_often() -> Iterator[None]:
    """Redraw often, with the view moving, and watch the memory."""
    data = areas()[0].spaces[0].region_3d
    set_view(areas()[0], "PERSP")
    memory = []
    for number in range(REDRAWS):
        if number % 4 == 0:
            data.view_distance *= 1.01 if number % 8 else 1 / 1.01
        areas()[0].tag_redraw()
        if number in (REDRAWS // 5, REDRAWS - 1):
            memory.append(read_memory()[0])
        yield
    report["memory after a fifth and all of the redraws, MB"] = memory
    yield from until_drawn("after_redraws")


def move_one_of_many() -> Iterator[None]:
    scene = bpy.context.scene
    for number in range(1000):
        mesh = bpy.data.objects["Cube"].data.copy()
        cube = bpy.data.objects.new(f"Copy {number}", mesh)
        cube.location, cube.scale = (number % 40 - 20, number // 40 - 10, -2.0), (0.4, 0.4, 0.4)
        scene.collection.objects.link(cube)
    yield from until_drawn("many")
    updates.clear()
    yield from time_first_picture(
        "first picture, one of 1000 moved", lambda: setattr(bpy.data.objects["Copy 500"].location, "z", -1.0)
    )
    report["update after moving one of 1000, seconds of this thread"] = max(updates)


def show_half_a_million() -> Iterator[None]:
    scene = bpy.context.scene
    for found in [found for found in scene.objects if found.type == "MESH"]:
        bpy.data.objects.remove(found)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=500, y_subdivisions=500, size=8.0)
    grid = bpy.context.object
    texture = bpy.data.textures.new("Clouds", "CLOUDS")
    displace = grid.modifiers.new("Displace", "DISPLACE")
    displace.texture, displace.strength = texture, 0.8
    set_view(areas()[0], "CAMERA")
    yield from until_drawn("half_a_million")
    report["triangles"] = sum(
        len(entry.geometry.mesh.triangles) for entry in viewports()[0].session._kept.meshes.values()
    )
    yield from time_first_picture("first picture, 500,000 triangles moved", lambda: setattr(grid.location, "z", -0.2))
    yield from time_first_picture(
        "first picture, 500,000 triangles, camera moved",
        lambda: setattr(bpy.data.objects["Camera"].location, "z", 5.5),
    )
    yield from time_first_picture(
        "first picture, 500,000 triangles reshaped", lambda: setattr(displace, "strength", 0.7)
    )
    yield from until_drawn("half_a_million_again")


STEPS = (
    show_default_scene,
    show_borders,
    show_two_viewports,
    change_and_undo,
    show_error,
    redraw_often,
    leave_and_return,
    move_one_of_many,
    show_half_a_million,
)


def run_steps() -> Iterator[None]:
    for step in STEPS:
        if CHOSEN and step.__name__ not in CHOSEN:
            continue
        draws.clear()
        yield from step()
        report[f"draws of {step.__name__}"] = {
            "count": len(draws),
            "longest": max((wall for wall, _ in draws), default=0.0),
            "longest of this thread": max((own for _, own in draws), default=0.0),
        }
        save_report()


def save_report() -> None:
    (FOLDER / "report.json").write_text(json.dumps(report, indent=1), encoding="utf-8")


steps = run_steps()


def go_on() -> float | None:
    """Take the next step; write the report after the last, and leave Blender while it draws."""
    try:
        next(steps)
    except StopIteration:
        report["finished"] = True
    except Exception:  # a timer's errors are lost in Blender: the test that reads the report fails by this
        report["error"] = traceback.format_exc()
    else:
        return 0.005
    report["process at exit"] = [one.session._live.process_id for one in viewports()]
    save_report()
    bpy.ops.wm.quit_blender()
    return None


bpy.context.preferences.view.show_splash = False
bpy.context.preferences.filepaths.use_load_ui = True
addon.register()
bpy.app.timers.register(go_on, first_interval=1.0, persistent=True)
