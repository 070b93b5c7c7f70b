"""A flat tree for rays without order: packets of rays meet tables of boxes, triangles and spheres by matrix products.

In: a query's rays, triangles with world corners, spheres. Out: pairs of ray and primitive that it settles or offers.
"""
