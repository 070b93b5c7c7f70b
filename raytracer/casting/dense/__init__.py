"""A flat tree for rays without order: packets of rays meet tables of boxes and triangles by matrix products.

In: a query's rays and triangles with world corners. Out: pairs of ray and triangle that it settles or offers.
"""
