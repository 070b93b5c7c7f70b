"""Compare from the panel: progress, Esc, the heat map, the list of worst pixels; the user's scene stays as it was."""

from __future__ import annotations

import hashlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import stage

WAIT_SECONDS = 120.0


def open_compare() -> None:
    """Let the panel Compare start open, and the others closed."""
    stage.import_addon()
    from addon import panels
    from addon.compare import window

    for panel in panels.CLASSES:
        if getattr(panel, "bl_context", "") == "render":
            panel.bl_options = {"DEFAULT_CLOSED"}
    window.panels.RAYTRACER_RENDER_PT_compare.bl_options = set()


open_compare()
stage.register_addon()


def prepare() -> float:
    """Render; the render tab with the panel Compare open beside an image editor and a 3D view."""
    scene = bpy.context.scene
    scene.render.engine = "REFERENCE_RAYTRACER"
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 96, 64, 100
    scene.reference_raytracer.samples = 1
    bpy.ops.render.render()
    with stage.within(stage.find_area("VIEW_3D")):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.4)
    image = stage.find_area("VIEW_3D", 1)
    image.type = "IMAGE_EDITOR"
    image.spaces.active.image = bpy.data.images["Render Result"]
    stage.find_area("PROPERTIES").spaces.active.context = "RENDER"
    outliner = stage.find_area("OUTLINER")
    outliner.type = "PROPERTIES"  # a second one, for the panel alone
    outliner.spaces.active.context = "RENDER"
    return 1.0


def choose_size() -> float:
    """Set what the panel asks for; remember what must stay."""
    state = bpy.context.window_manager.reference_raytracer_comparison
    state.width, state.samples, state.rays = 48, 4, 256
    stage.record["before"] = describe_user()
    return 1.0


def describe_user() -> dict[str, str]:
    """Return what must stay: settings, engine, file, selection and the pixels of the result."""
    scene = bpy.context.scene
    values = {}
    for owner in (
        scene.render,
        scene.render.image_settings,
        scene.reference_raytracer,
        scene.view_layers[0],
        scene.cycles,
    ):
        for item in owner.bl_rna.properties:
            if item.type not in ("POINTER", "COLLECTION"):
                values[f"{owner.bl_rna.identifier}.{item.identifier}"] = repr(getattr(owner, item.identifier))
    picture = stage.folder / "result.png"
    bpy.data.images["Render Result"].save_render(str(picture), scene=scene)
    values["result"] = hashlib.sha256(picture.read_bytes()).hexdigest()
    picture.unlink()
    values["file"] = bpy.data.filepath
    values["dirty"] = repr(bpy.data.is_dirty)
    recent = Path(bpy.utils.user_resource("CONFIG")) / "recent-files.txt"
    values["recent"] = recent.read_text(encoding="utf-8") if recent.exists() else ""
    values["objects"] = repr([(one.name, one.select_get(), list(one.matrix_world.row[0])) for one in scene.objects])
    values["pointers"] = repr(sorted(scene.keys()))
    return values


def start(operator: str) -> stage.Step:
    """Return a step that presses a button of the panel."""

    def step() -> float:
        with stage.within(stage.find_area("PROPERTIES")):
            getattr(bpy.ops.raytracer, operator)("INVOKE_DEFAULT", width=48)
        return 4.0

    return step


def record_running(name: str) -> stage.Step:
    """Return a step that writes down whether a comparison runs."""

    def step() -> None:
        state = bpy.context.window_manager.reference_raytracer_comparison
        stage.record[name] = [state.is_running, state.progress]

    return step


def press_escape() -> float:
    """Esc ends it."""
    stage.press("ESC", 600, 400)
    return 1.0


def wait() -> Iterator[stage.Step]:
    """Yield steps until the comparison is done."""
    end = time.monotonic() + WAIT_SECONDS
    while True:
        yield lambda: None
        if not bpy.context.window_manager.reference_raytracer_comparison.is_running:
            return
        if time.monotonic() > end:
            raise TimeoutError("the comparison did not end")


def record_outcome(name: str) -> stage.Step:
    """Return a step that writes down what came out."""

    def step() -> float:
        from addon.compare.window import session

        outcome = session.find_outcome()
        stage.record[name] = outcome.as_plain() if outcome else None
        stage.record[f"{name}_image"] = list(bpy.data.images["Raytracer Difference"].size)
        stage.record[f"{name}_shown"] = stage.find_area("IMAGE_EDITOR").spaces.active.image.name
        with stage.within(stage.find_area("IMAGE_EDITOR")):
            bpy.ops.image.view_all(fit_view=True)
        return 1.0

    return step


def click_worst(name: str) -> stage.Step:
    """Return a step that chooses a row of the list."""

    def step() -> float:
        from addon.compare.window import session

        bpy.context.window_manager.reference_raytracer_comparison.worst_index = 0
        verdicts = session.find_verdicts()
        assert verdicts is not None
        stage.record[name] = [[verdict.is_right, verdict.t_error, verdict.distance_error] for verdict in verdicts]
        stage.record[f"{name}_rays"] = len(bpy.context.window_manager.reference_raytracer.rays)
        return 1.0

    return step


def record_user() -> None:
    """What must be as before."""
    stage.record["after"] = describe_user()


def fill_window() -> float:
    """Let the render tab fill the window, so that all of the panel is seen."""
    with stage.within(stage.find_area("PROPERTIES", 1)):
        bpy.ops.screen.screen_full_area()
    return 2.0


def steps() -> Iterator[stage.Step]:
    """Yield all steps."""
    yield from (prepare, choose_size)
    yield from (start("compare_cycles"), record_running("running"), stage.take_picture("progress"), press_escape)
    yield record_running("cancelled")
    yield start("compare_ray_cast")
    yield from wait()
    yield from (record_outcome("ray_cast"), click_worst("ray_cast_worst"))
    yield from stage.show_tab("VIEW_3D", "Ray")
    yield stage.take_picture("ray_cast")
    yield start("compare_cycles")
    yield from wait()
    yield from (record_outcome("cycles"), click_worst("cycles_worst"), record_user, stage.take_picture("cycles"))
    yield from (fill_window, stage.take_picture("list"))


stage.play(steps())
