"""Light sources: lights, emissive geometry and the world, each sampled and evaluated.

In: points that wait for light. Out: directions, radiance over density, densities.
"""
