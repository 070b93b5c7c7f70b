"""Signs that decide: edge functions and their kin in float64 with error bounds, in pairs of floats, in integers.

In: coordinates. Out: signs and distances that are certain, or the word that they are not. `filtered` comes first; what
it leaves open `refine` and, last, `exact` settle. Nothing else in the ray tracer decides what a ray hits.
"""
