import bpy

settings = bpy.context.scene.reference_raytracer

settings.samples = 1024
settings.viewport_samples = 128
settings.clamp_direct = 0.0
settings.clamp_indirect = 0.0
settings.filter_glossy = 0.0
