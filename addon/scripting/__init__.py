"""For scripts and other add-ons: `addon.ray_cast`, Scene.ray_cast for arrays.

In: a depsgraph and rays. Out: hits as Blender reports them. `held` keeps the caster from call to call.
"""
