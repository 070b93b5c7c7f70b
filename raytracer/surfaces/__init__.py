"""From a hit to a point on a surface: position with a bound on its error, normals, uvs; where the next ray may start.

In: rays and hits. Out: `Surface` of n points, and origins that avoid self-intersection.
"""
