"""Finding what rays hit: `caster` is the public face, `search` decides, the rest finds candidates."""

from raytracer.accelerate.caster import Caster, build
from raytracer.memory import keep_freed_memory

__all__ = ["Caster", "build"]

# Once per process, workers included.
keep_freed_memory()
