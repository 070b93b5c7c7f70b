"""How surfaces scatter: Fresnel, facets, diffuse shapes, and the closures made of them.

In: directions, normals and parameters. Out: values, samples and densities, the same three for every kind.
"""
