"""The panels: drawn with a layout that writes down what is asked of it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import bpy
import pytest

from addon import properties, versions
from addon.extract.camera import PANORAMAS
from addon.panels import bake, built_in, camera, linking, render, resume, scene_data, view_layer
from addon.passes import MATTE_OPTIONS, PASSES, enable_passes, enabled_passes, find_pass, list_options
from addon.properties import ENGINE
from raytracer.film import passes
from raytracer.integrator import settings
from tests.addon.panels.panel_fixtures import draw, registered

__all__ = ["registered"]  # a fixture


def test_simplify_panel_draws_what_blender_follows(empty_scene: Any, registered: None) -> None:
    names = draw(render.RAYTRACER_RENDER_PT_simplify).names
    limits = ("simplify_subdivision", "simplify_child_particles")
    assert names == ["use_simplify", *(f"{limit}{end}" for limit in limits for end in ("", "_render"))]


def test_every_setting_is_drawn_once_and_explained(empty_scene: Any, registered: None) -> None:
    chosen = [panel for panel in render.CLASSES if panel is not render.RAYTRACER_RENDER_PT_simplify]
    assert "Workers: " in " ".join(draw(render.RAYTRACER_RENDER_PT_performance).texts)
    empty_scene.reference_raytracer.workers_mode = "FIXED"
    drawn = [name for panel in chosen for name in draw(panel).names] + ["bake_type"]
    assert "bake_type" in draw(bake.RAYTRACER_RENDER_PT_bake).names
    own = [
        item
        for item in empty_scene.reference_raytracer.bl_rna.properties
        if item.identifier not in ("name", "rna_type")
    ]
    assert sorted(drawn) == sorted([item.identifier for item in own] + ["film_transparent"])
    assert all(item.description for item in own)


def test_the_render_menu_offers_to_resume_where_checkpoints_are_kept(empty_scene: Any, registered: None) -> None:
    assert resume.draw_item in bpy.types.TOPBAR_MT_render.draw._draw_funcs
    item = SimpleNamespace(draw=resume.draw_item)
    empty_scene.render.engine = ENGINE
    assert not draw(item).buttons
    empty_scene.reference_raytracer.use_checkpoints = True
    assert [button.name for button in draw(item).buttons] == ["raytracer.resume_render"]
    empty_scene.render.engine = "BLENDER_WORKBENCH"
    assert not draw(item).buttons


def test_settings_reach_the_ray_tracer_by_their_names(empty_scene: Any, registered: None) -> None:
    keywords = properties.settings_keywords(empty_scene)
    assert settings.Settings(**keywords).samples == 64
    assert keywords["workers"] == properties.count_processors() >= 1
    empty_scene.reference_raytracer.workers = 3
    empty_scene.reference_raytracer.pixel_filter = "BOX"
    assert properties.settings_keywords(empty_scene)["workers"] == 3
    assert properties.settings_keywords(empty_scene)["pixel_filter"] == "box"


def test_workers_follow_the_processors_until_they_are_fixed(empty_scene: Any, registered: None) -> None:
    own = empty_scene.reference_raytracer
    assert (own.workers_mode, own.workers) == ("AUTO", 0)
    own.workers_mode = "FIXED"
    assert own.workers == properties.count_processors()
    own.workers = 3
    own.workers_mode = "FIXED"
    assert (own.workers_mode, own.workers) == ("FIXED", 3)
    own.workers_mode = "AUTO"
    assert own.workers == 0


def test_choices_are_those_of_the_ray_tracer() -> None:
    assert tuple(name.lower() for name, *_ in properties.PRECISIONS) == settings.PRECISIONS
    assert tuple(name.lower() for name, *_ in properties.PIXEL_FILTERS) == tuple(settings.FILTER_WIDTHS)


def test_passes_are_those_of_the_film() -> None:
    for name, traced in passes.PASSES.items():
        assert (name in PASSES) == (not traced.matte)
        assert len(find_pass(name).channels) == traced.channels


def test_passes_panel_switches_what_the_engine_reads(empty_scene: Any, registered: None) -> None:
    drawn = draw(view_layer.RAYTRACER_VIEWLAYER_PT_passes).names
    assert drawn == [option.split(".")[-1] for option in list_options() if option != "use_pass_combined"]
    layer = bpy.context.view_layer
    for name, stored in PASSES.items():
        enable_passes(layer, (name,))
        switched = [other for other in PASSES if PASSES[other].option in ("use_pass_combined", stored.option)]
        assert enabled_passes(layer) == tuple(switched)
    layer.use_pass_combined = False  # as a file of another engine may have it; Blender keeps the pass all the same
    assert "Combined" in enabled_passes(layer)


def test_cryptomatte_panel_switches_two_levels_a_pass(empty_scene: Any, registered: None) -> None:
    layer = bpy.context.view_layer
    names = draw(view_layer.RAYTRACER_VIEWLAYER_PT_cryptomatte).names
    assert names == [*MATTE_OPTIONS.values(), "pass_cryptomatte_depth"]
    enable_passes(layer, ("CryptoAsset01",))
    assert enabled_passes(layer) == ("Combined", "CryptoAsset00", "CryptoAsset01")
    layer.pass_cryptomatte_depth, layer.use_pass_cryptomatte_object = 2, True
    assert enabled_passes(layer) == ("Combined", "CryptoObject00", "CryptoAsset00")
    enable_passes(layer, ("Depth",))
    assert enabled_passes(layer) == ("Combined", "Depth")


def test_aov_panel_lists_what_shaders_write(empty_scene: Any, registered: None) -> None:
    layer = bpy.context.view_layer
    shown = draw(view_layer.RAYTRACER_VIEWLAYER_PT_aov)
    assert (shown.names, shown.texts) == (["aovs"], [])
    assert [button.name for button in shown.buttons] == ["scene.view_layer_add_aov", "scene.view_layer_remove_aov"]
    for button in shown.buttons[:1]:
        group, name = button.name.split(".")
        getattr(getattr(bpy.ops, group), name)()
    layer.aovs[0].name, layer.aovs[0].type = "mask", "VALUE"
    assert enabled_passes(layer) == ("Combined", "AOV Value mask")
    stored = find_pass("AOV Value mask")
    assert (stored.channels, stored.kind, versions.blender_pass_name("AOV Value mask")) == ("X", "VALUE", "mask")
    assert len(find_pass("AOV Color mask").channels) == passes.find_pass("AOV Color mask").channels


def test_light_groups_are_listed_and_given_to_objects_and_the_world(empty_scene: Any, registered: None) -> None:
    layer, world = bpy.context.view_layer, bpy.data.worlds.new("World")
    shown = draw(view_layer.RAYTRACER_VIEWLAYER_PT_light_groups)
    assert shown.names == ["lightgroups"]
    assert [button.name.split("_")[-2] for button in shown.buttons] == ["add", "remove"]
    layer.lightgroups.add(name="key")
    assert enabled_passes(layer) == ("Combined", "Combined_key")
    assert (find_pass("Combined_key").channels, versions.blender_pass_name("Combined_key")) == ("RGB", "Combined_key")
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    for panel, owner in (
        (scene_data.RAYTRACER_OBJECT_PT_light_group, {"object": lamp}),
        (scene_data.RAYTRACER_WORLD_PT_light_group, {"world": world}),
    ):
        (owned,) = owner.values()
        owned.lightgroup = "rim"
        drawn = draw(panel, **owner)
        assert (drawn.names, drawn.buttons[0].name) == (["lightgroup"], "rim")


@pytest.mark.parametrize("kind", ["POINT", "SUN", "SPOT", "AREA"])
def test_light_panel_draws_every_kind_of_light(empty_scene: Any, registered: None, kind: str) -> None:
    light = bpy.data.lights.new("Light", kind)
    names = draw(scene_data.RAYTRACER_LIGHT_PT_tracing, light=light).names
    expected, own = (["use_shadow", "spread"], ["is_portal"]) if kind == "AREA" else (["use_shadow"], [])
    own += ["max_bounces", "is_caustics_light"]
    assert names == [*expected, *(own if hasattr(light, "cycles") else [])]


def test_panorama_panel_draws_every_kind_that_is_read(empty_scene: Any, registered: None) -> None:
    lens, panel = bpy.data.cameras.new("Lens"), camera.RAYTRACER_CAMERA_PT_panorama
    context = SimpleNamespace(camera=lens, engine=ENGINE)
    assert not panel.poll(context)
    lens.type = "PANO"
    assert panel.poll(context)
    kinds = [item.identifier for item in lens.bl_rna.properties["panorama_type"].enum_items]
    assert kinds
    assert set(kinds) <= PANORAMAS.keys()
    asked = {}
    for lens.panorama_type in kinds:
        first, *asked[lens.panorama_type] = draw(panel, camera=lens).names
        assert first == "panorama_type"
    assert asked["FISHEYE_EQUISOLID"] == ["fisheye_lens", "fisheye_fov"]
    assert asked["MIRRORBALL"] == []
    assert sum(map(len, asked.values())) == 13 + 5 * ("CENTRAL_CYLINDRICAL" in kinds)


def test_caustics_panel_is_there_for_what_becomes_a_mesh(empty_scene: Any, registered: None) -> None:
    mesh, lamp = bpy.data.meshes.new("Mesh"), bpy.data.lights.new("Lamp", "POINT")
    ball, light = (bpy.data.objects.new(data.name, data) for data in (mesh, lamp))
    panel = scene_data.RAYTRACER_OBJECT_PT_caustics
    engine = bpy.context.scene.render.engine
    assert draw(panel, object=ball).names == ["is_caustics_caster", "is_caustics_receiver"]
    polled = [panel.poll(SimpleNamespace(object=thing, engine=engine)) for thing in (ball, light, None)]
    assert polled == [engine in panel.COMPAT_ENGINES, False, False]


def test_world_and_light_panels_draw_their_nodes(empty_scene: Any, registered: None) -> None:
    world, light = bpy.data.worlds.new("World"), bpy.data.lights.new("Light", "SUN")
    for owner in (world, light):
        if versions.find_node_tree(owner) is None:
            owner.use_nodes = True
    for panel, name, owner, shown in (
        (scene_data.RAYTRACER_WORLD_PT_surface, "world", world, "Surface"),
        (scene_data.RAYTRACER_WORLD_PT_volume, "world", world, "Volume"),
        (scene_data.RAYTRACER_LIGHT_PT_nodes, "light", light, "Surface"),
    ):
        (tree, output, socket) = draw(panel, **{name: owner}).views[0]
        assert (tree, output.type, socket.name) == (owner.node_tree, f"OUTPUT_{name.upper()}", shown)
    for panel, name, owner in (
        (scene_data.RAYTRACER_WORLD_PT_surface, "world", world),
        (scene_data.RAYTRACER_LIGHT_PT_nodes, "light", light),
    ):
        owner.node_tree.nodes.clear()
        assert draw(panel, **{name: owner}).texts == ["No output node"]
    names = draw(scene_data.RAYTRACER_WORLD_PT_ray_visibility, world=world).names
    assert names == ["camera", "diffuse", "glossy", "transmission", "scatter"]
    assert draw(scene_data.RAYTRACER_WORLD_PT_settings, world=world).names == ["max_bounces"]


def test_noise_threshold_and_time_limit_reach_the_ray_tracer(empty_scene: Any, registered: None) -> None:
    keywords = properties.settings_keywords(empty_scene)
    assert (keywords["error"], keywords["seconds"]) == (None, None)
    own = empty_scene.reference_raytracer
    own.use_noise_threshold, own.noise_threshold, own.min_samples, own.time_limit = True, 2.5, 32, 60.0
    chosen = settings.Settings(**properties.settings_keywords(empty_scene))
    assert (round(chosen.error or 0.0, 9), chosen.min_samples, chosen.seconds) == (0.025, 32, 60.0)


def test_ray_visibility_and_material_panels_draw_what_is_read(empty_scene: Any, registered: None) -> None:
    thing = bpy.data.objects.new("Thing", bpy.data.meshes.new("Thing"))
    visibility = scene_data.RAYTRACER_OBJECT_PT_ray_visibility
    assert visibility.poll(SimpleNamespace(object=thing, engine=ENGINE))
    assert not visibility.poll(SimpleNamespace(object=None, engine=ENGINE))
    names = draw(visibility, object=thing).names
    kinds = ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow")
    assert names == [f"visible_{kind}" for kind in kinds]
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    assert draw(visibility, object=lamp).names == names[:-1]
    for data in (bpy.data.hair_curves.new("Hair"), bpy.data.pointclouds.new("Points"), bpy.data.volumes.new("Smoke")):
        assert visibility.poll(SimpleNamespace(object=bpy.data.objects.new("Thing", data), engine=ENGINE))
    material = bpy.data.materials.new("Material")
    assert scene_data.RAYTRACER_MATERIAL_PT_settings.poll(SimpleNamespace(material=material, engine=ENGINE))
    names = draw(scene_data.RAYTRACER_MATERIAL_PT_settings, material=material).names
    own = [name for name in ("use_bump_map_correction", "volume_interpolation") if hasattr(material.cycles, name)]
    assert names == ["use_transparent_shadow", "pass_index", "displacement_method", *own]


def test_shadow_terminator_panel_draws_what_is_read(empty_scene: Any, registered: None) -> None:
    ball, lamp = (bpy.data.objects.new("Thing", data) for data in (bpy.data.meshes.new("M"), None))
    panel = scene_data.RAYTRACER_OBJECT_PT_shadow_terminator
    assert panel.poll(SimpleNamespace(object=ball, engine=ENGINE))
    assert not panel.poll(SimpleNamespace(object=lamp, engine=ENGINE))
    owner, names = versions.find_terminator(ball)
    assert tuple(draw(panel, object=ball).names) == names
    for name, value in zip(names, (0.5, 0.25), strict=True):
        setattr(owner, name, value)
    assert versions.read_terminator(ball) == (0.5, 0.25)


def test_light_and_shadow_linking_can_be_set(empty_scene: Any, registered: None) -> None:
    """In 4.2 the panels are Cycles' alone."""
    labels = {
        panel.bl_label
        for panel in built_in.all_subclasses(bpy.types.Panel)
        if panel.is_registered and ENGINE in getattr(panel, "COMPAT_ENGINES", {ENGINE})
    }
    assert {"Light Linking", "Shadow Linking"} <= labels


@pytest.mark.parametrize("kind", ["receiver", "blocker"])
def test_linking_panels_draw_what_is_linked(empty_scene: Any, registered: None, kind: str) -> None:
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    panel = {
        "receiver": linking.RAYTRACER_OBJECT_PT_light_linking,
        "blocker": linking.RAYTRACER_OBJECT_PT_shadow_linking,
    }
    assert draw(panel[kind], object=lamp).names == [f"{kind}_collection"]
    setattr(lamp.light_linking, f"{kind}_collection", bpy.data.collections.new("Linked"))
    layout = draw(panel[kind], object=lamp)
    assert layout.names == [f"{kind}_collection"] * 2
    names = [f"{kind}_collection_new", f"{kind}s_link", "unlink_from_collection"]
    assert [button.name for button in layout.buttons] == [f"object.light_linking_{name}" for name in names]
    assert all(getattr(bpy.ops.object, f"light_linking_{name}").get_rna_type() for name in names)


def test_world_panels_set_the_distances_of_passes(empty_scene: Any, registered: None) -> None:
    world, mist = bpy.data.worlds.new("World"), scene_data.RAYTRACER_WORLD_PT_mist
    context = SimpleNamespace(scene=empty_scene, world=world, engine=ENGINE)
    assert not mist.poll(context)
    bpy.context.view_layer.use_pass_mist = True
    assert mist.poll(context)
    assert draw(mist, world=world).names == ["start", "depth", "falloff"]
    assert draw(scene_data.RAYTRACER_WORLD_PT_occlusion, world=world).names == ["distance"]
    world.mist_settings.start, world.mist_settings.depth, world.light_settings.distance = 2.0, 8.0, 0.5
    assert properties.read_world_settings(world) == {"mist": (2.0, 8.0, 2.0), "occlusion_distance": 0.5}


def test_shadow_catcher_is_shown_for_what_can_be_seen(empty_scene: Any, registered: None) -> None:
    panel = scene_data.RAYTRACER_OBJECT_PT_shadow_catcher
    assert draw(panel, object=bpy.data.objects.new("Thing", bpy.data.meshes.new("Thing"))).names == [
        "is_shadow_catcher"
    ]
    assert not panel.poll(SimpleNamespace(object=bpy.data.objects.new("Empty", None), engine=ENGINE))


def test_override_panel_draws_what_this_blender_has(empty_scene: Any, registered: None) -> None:
    names = draw(view_layer.RAYTRACER_VIEWLAYER_PT_override).names
    has_world = "world_override" in bpy.context.view_layer.bl_rna.properties
    assert names == ["material_override", "world_override"][: 1 + has_world]


def test_filter_panel_draws_what_the_engine_heeds(empty_scene: Any, registered: None) -> None:
    names = ["use_sky", "use_solid", "use_strand", "use_volumes", "use_motion_blur"]
    assert draw(view_layer.RAYTRACER_VIEWLAYER_PT_filter).names == names
