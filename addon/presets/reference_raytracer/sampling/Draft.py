import bpy

settings = bpy.context.scene.reference_raytracer

settings.samples = 8
settings.viewport_samples = 4
settings.clamp_direct = 0.0
settings.clamp_indirect = 10.0
settings.filter_glossy = 1.0
