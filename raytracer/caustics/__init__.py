"""Caustics by manifold next event estimation: light that clear glass bends on its way to a surface, found from there by
Newton's method and not by chance. Cycles calls it shadow caustics."""
