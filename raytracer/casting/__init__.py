"""Casting: what rays hit.

In: a scene's geometry and arrays of rays. Out: `Hits`, by `Caster.closest_hit`, `any_hit` and `crossings`. `bvh`,
`pencil`, `matrix_form` and `brute_force` only find candidates; `query` decides among them, in one place, by
`predicates`.
"""

from raytracer.casting.caster import Caster, build

__all__ = ["Caster", "build"]
