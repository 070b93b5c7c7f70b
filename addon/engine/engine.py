"""The render engine: Blender calls `render` once for each view layer of a frame, and `view_draw` for each redraw.

Reading the scene, building, tracing and writing are `extract`, `raytracer.build`, `raytracer.render` and `output`;
`animation` keeps what the next frame can use again, `viewport` draws regions in Rendered shading. This module orders
them, tells Blender how far they are, and turns every error into one sentence.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import bpy

import raytracer
from raytracer.processes.python import print_traceback
from raytracer.processes.workers import WorkerError

from .. import interrupts
from ..extract.scene import Extraction, extract_scene
from ..extract.shutter import SetFrame, is_blurred
from ..extract.warnings import Warning
from ..passes import declare_passes, enabled_passes
from ..properties import ENGINE, settings_keywords
from ..versions import find_world
from ..viewport import viewport
from ..viewport.viewport import Viewport
from . import animation, checkpoints, orders, statistics, worker_pool
from .animation import Frames
from .baking import bake_object
from .finishing import finish_picture, is_finished_later
from .light_groups import give_groups
from .mattes import describe_mattes, give_identities, name_things
from .output import Border, RenderOutput, read_border
from .progress import Progress
from .stereo import count_pictures, find_unsupported, find_view, list_views, look_from_view
from .tracing import trace

OF_FIRST_SURFACE = {"Depth", "Position", "Normal", "UV", "Object Index", "Material Index", "Vector"}


class SceneError(Exception):
    """The scene cannot be rendered; the user can change that."""


class ReferenceRaytracerEngine(bpy.types.RenderEngine):
    """Reference Ray Tracer in Blender's list of render engines; an object renders one frame, or draws one region."""

    bl_idname = ENGINE
    bl_label = "Reference Ray Tracer"
    bl_use_eevee_viewport = True  # Material Preview is drawn by EEVEE
    bl_use_preview = True  # small pictures of materials, worlds and lights
    bl_use_shading_nodes_custom = False  # the nodes are Blender's own: without this there is no Shader Editor
    bl_use_spherical_stereo = True  # cameras show the setting

    layers_done = 0  # of this frame, each of their stereo views counted
    layers: frozenset[str] = frozenset()  # names of those that this frame has begun
    is_baking = False
    baked_images = 0
    baked_warnings: frozenset[str] = frozenset()  # of a bake, that the user has been told
    viewport: Viewport | None = None  # what a viewport shows, while this object serves one
    failed = False  # an error in one view layer ends the frame, with one message instead of one for each layer

    def update_render_passes(self, scene: Any = None, renderlayer: Any = None) -> None:
        """Declare the passes of a view layer (Blender's callback)."""
        declare_passes(self, scene, renderlayer)

    def render(self, depsgraph: Any) -> None:
        """Render one view layer into Blender's render result (Blender's callback)."""
        self._begin_layer(depsgraph.scene, depsgraph.view_layer)
        if self.failed or self.test_break():
            return
        for view in list_views(depsgraph.scene_eval):
            with self._reporting(), interrupts.release():
                render_view_layer(self, depsgraph, view)
            self.layers_done += 1
            if self.failed or self.test_break():
                return

    def _begin_layer(self, scene: Any, view_layer: Any) -> None:
        """Begin a new frame with its first view layer: with Persistent Data one object renders them all."""
        first = next((layer.name for layer in scene.view_layers if layer.use), view_layer.name)
        if view_layer.name in {first, *self.layers} or scene.render.use_single_layer:
            self.failed, self.layers_done, self.layers = False, 0, frozenset()
        self.layers |= {view_layer.name}

    def bake(self, depsgraph: Any, object: Any, pass_type: str, pass_filter: int, width: int, height: int) -> None:
        """Bake what an object shows into a texture (Blender's callback)."""
        if not self.is_baking:  # the object may be one that has rendered before
            self.is_baking, self.failed = True, False
        if self.failed or self.test_break():
            return
        with self._reporting(), interrupts.release():
            try:
                bake_object(self, depsgraph, object, pass_type, pass_filter, (width, height))
            except ValueError as error:
                raise SceneError(str(error)) from error

    @contextlib.contextmanager
    def _reporting(self) -> Iterator[None]:
        """Turn every error into one sentence; nothing may reach Blender: it would take the render for a success."""
        try:
            yield
        except KeyboardInterrupt:
            self._fail("interrupted")
        except MemoryError:
            self._fail("not enough memory")
        except SceneError as error:
            self._fail(str(error))
        except WorkerError as error:
            self.fail(error)
        except Exception as error:
            print_traceback(error)
            self._fail(f"internal error, {type(error).__name__}: {error}")

    def view_update(self, context: Any, depsgraph: Any) -> None:
        """Take a change of what a viewport shows (Blender's callback)."""
        self._find_viewport().update(context, depsgraph)

    def view_draw(self, context: Any, depsgraph: Any) -> None:
        """Draw a viewport in Rendered shading (Blender's callback)."""
        self._find_viewport().draw(self, context, depsgraph)

    def _find_viewport(self) -> Viewport:
        if self.viewport is None:
            self.viewport = Viewport(self)
        return self.viewport

    def __del__(self) -> None:
        # The frames of an error may keep the object longer than Blender does, which then refuses its attributes.
        viewport = object.__getattribute__(self, "viewport")
        if viewport is not None:
            viewport.close()

    def fail(self, error: WorkerError) -> None:
        """Tell that processes were lost, once for the frame, whose picture may go on to Blender all the same."""
        print_traceback(error)
        self._fail(str(error))

    def _fail(self, reason: str) -> None:
        self.failed = True
        if not self.is_preview:
            checkpoints.forget()
        self.report({"ERROR"}, f"{self.bl_label}: {' '.join(reason.split())}")


def render_view_layer(engine: Any, depsgraph: Any, view: str = "") -> None:
    """Read, build, trace and write the view layer of `depsgraph`, or one of its stereo views; report warnings, record
    what it took."""
    started = time.perf_counter()
    scene = depsgraph.scene_eval
    border = read_border(scene.render, engine.resolution_x, engine.resolution_y)
    with RenderOutput(engine, depsgraph.view_layer.name, border, view) as output:
        progress = Progress(engine, output, count_pictures(scene))
        progress.show_stage("Reading the scene")
        kept = animation.find_frames(engine, depsgraph)
        extraction = read_scene(depsgraph, kept, find_set_frame(engine, scene), engine.camera_override)
        view_layer = depsgraph.view_layer_eval  # changes of frames may have copied it anew
        warnings = (*extraction.warnings, *find_ignored_settings(depsgraph, extraction.scene.motion is not None))
        things = name_things(extraction, enabled_passes(view_layer))
        traced = look_from_view(engine, view, scene, give_identities(extraction.scene, things))
        world = find_world(scene, view_layer)
        traced = give_groups(traced, extraction, world, enabled_passes(view_layer))
        film = make_film(engine, traced, depsgraph, border, progress, kept)
        error = None if engine.is_preview else film.measure_error()
        width, height = film.width, film.height  # a film that is used up has none
        is_denoised = False
        if (width, height) == (border.width, border.height):  # a tile is no picture
            is_last = orders.find_order() is None and not is_finished_later(engine, scene, film)
            output.write_film(film, uses_up=is_last)
            output.note(describe_mattes(view_layer.name, things))
            is_denoised, reasons = finish_picture(engine, scene, film, output, progress.show_stage)
            warnings = (*warnings, *reasons)
    if error is None:
        return
    for warning in warnings:
        engine.report({"WARNING"}, str(warning))
    taken = statistics.Statistics(
        passes=enabled_passes(view_layer),
        width=width,
        height=height,
        samples=film.samples,
        triangles=statistics.count_triangles(extraction.scene),
        rays=film.statistics.rays,
        build_seconds=film.statistics.build_seconds,
        trace_seconds=film.statistics.trace_seconds,
        total_seconds=time.perf_counter() - started,
        peak_memory_mb=statistics.read_peak_memory(),
        warnings=warnings,
        cancelled=film.cancelled,
        ended_by=film.ended_by,
        error=error.error,
        error_interval=error.interval,
        error_p99=error.error_p99,
        error_note=error.note,
        denoised=is_denoised,
    )
    statistics.record_view_layer(depsgraph.scene, taken, first=engine.layers_done == 0)


def read_scene(depsgraph: Any, kept: Frames | None, set_frame: SetFrame | None, seen_from: Any) -> Extraction:
    """Return what the depsgraph shows, or raise SceneError with the reason why it cannot be rendered.

    set_frame, seen_from : as of `extract_scene`
    """
    passes, last = enabled_passes(depsgraph.view_layer_eval), kept.kept if kept else None
    try:
        return extract_scene(depsgraph, passes, kept=last, set_frame=set_frame, seen_from=seen_from)
    except ValueError as error:
        raise SceneError(str(error)) from error


def make_film(
    engine: Any, scene: raytracer.Scene, depsgraph: Any, border: Border, progress: Progress, kept: Frames | None
) -> Any:
    """Return the film of one view layer as a command has ordered it, which most often is to trace it."""
    order = orders.find_order()
    if order is None or engine.is_preview:
        return make_checked_film(engine, scene, depsgraph, border, progress, kept)
    if count_pictures(depsgraph.scene_eval) > 1:
        raise SceneError(
            "films and scene files are of one view layer without stereoscopy: "
            "expected Use for Rendering to be on in one"
        )
    if isinstance(order, orders.ShowFilm):
        return order.film
    try:
        if isinstance(order, orders.ExportScene):
            passes = enabled_passes(depsgraph.view_layer_eval)
            settings = {**settings_keywords(depsgraph.scene_eval), "passes": passes, "border": tuple(border)}
            return order.export(scene, engine.resolution_x, engine.resolution_y, settings)
        return trace(engine, scene, depsgraph, border, progress, kept, order.render)
    except ValueError as error:  # a film's file that is broken, or of another picture
        raise SceneError(str(error)) from error
    except OSError as error:  # a full disk
        raise SceneError(f"{error.filename}: {error.strerror}" if error.filename else str(error)) from error


def make_checked_film(
    engine: Any, scene: raytracer.Scene, depsgraph: Any, border: Border, progress: Progress, kept: Frames | None
) -> raytracer.Film:
    """Return the traced film of one view layer, with checkpoints where the scene asks for them."""
    if not checkpoints.is_wanted(engine, depsgraph.scene):
        return trace(engine, scene, depsgraph, border, progress, kept, raytracer.render)
    try:
        order = checkpoints.make_order(
            engine, depsgraph.scene, depsgraph.view_layer.name, find_view(engine, depsgraph.scene)
        )
        film = trace(engine, scene, depsgraph, border, progress, kept, order.render)
        checkpoints.settle(order.path, film)
    except ValueError as error:  # a checkpoint that is broken, or of another picture
        raise SceneError(str(error)) from error
    except OSError as error:
        raise SceneError(f"Checkpoints: {error.filename}: {error.strerror}") from error
    views = list_views(depsgraph.scene)
    done, total = engine.layers_done + 1, count_pictures(depsgraph.scene_eval)
    if depsgraph.scene.render.use_single_layer:
        total = len(views)
    if not film.cancelled and done >= total:
        checkpoints.spend_files(depsgraph.scene)
    return film


def find_set_frame(engine: Any, scene: Any) -> SetFrame | None:
    """Return what has the depsgraph show other frames; None for previews, and for stereo views, whose cameras are not
    where motion is read."""
    return None if engine.is_preview or scene.render.use_multiview else engine.frame_set


def find_ignored_settings(depsgraph: Any, moves: bool) -> list[Warning]:
    """Return one warning for each setting that the picture does not follow.

    moves : True where something moves while the shutter is open
    """
    scene, view_layer = depsgraph.scene_eval, depsgraph.view_layer_eval
    is_adaptive = moves and scene.reference_raytracer.use_adaptive_sampling
    is_stereo = is_blurred(depsgraph) and scene.render.use_multiview
    samples = f"Samples of a view layer's own are not supported: '{view_layer.name}' has those of the scene"
    is_threshold = view_layer.pass_alpha_threshold != 0.5 and OF_FIRST_SURFACE & set(enabled_passes(view_layer))
    threshold = "Alpha thresholds of passes are not supported: they tell of the first surface that is half opaque"
    ignored = (
        (is_adaptive, "Adaptive sampling does not go with motion blur: all pixels have the same number of samples"),
        (is_stereo, "Motion blur is not supported with stereoscopy: the picture shows one moment"),
        (view_layer.samples > 0, samples),
        (is_threshold, threshold),
    )
    return [
        *(Warning(text) for is_used, text in ignored if is_used),
        *find_unsupported(scene, enabled_passes(view_layer)),
    ]


def register() -> None:
    """Add the engine to Blender's list."""
    bpy.utils.register_class(ReferenceRaytracerEngine)
    viewport.register()
    animation.register()
    checkpoints.register()


def unregister() -> None:
    """Take the engine out of Blender's list and forget the renders of this session."""
    bpy.utils.unregister_class(ReferenceRaytracerEngine)
    viewport.unregister()
    animation.unregister()
    checkpoints.unregister()
    worker_pool.close()
    statistics.forget_all()
