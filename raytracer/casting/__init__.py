"""Casting: what rays hit.

In: a scene's geometry and arrays of rays. Out: `Hits`, by `Caster.closest_hit`, `any_hit` and `crossings`. `bvh`,
`dense`, `pencil`, `matrix_form` and `brute_force` only find candidates; `query` decides among them, in one place, by
`predicates`; `planes` settles for it what is clear in float64.
"""

from raytracer.casting.caster import Caster, build

__all__ = ["Caster", "build"]
