"""Finding what rays hit: `caster` is the public face, `search` decides, the rest finds candidates."""

from raytracer.accelerate.caster import Caster, build

__all__ = ["Caster", "build"]
