"""From a point on a surface to its closures: shader programs are run where materials need them.

In: `Surface` and what is known of the path. Out: `Shading`, the parameters of all closures at n points.
"""
