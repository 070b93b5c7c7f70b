"""Hits of rays with curves: ribbons that face the ray, and round strands.

Which is met is decided in float64, with a bound on the error; triangles and spheres know nothing of it.
"""
