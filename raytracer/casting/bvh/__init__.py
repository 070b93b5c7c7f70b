"""The tree of boxes: candidates for rays of any kind, instances and spheres included.

In: a query's rays. Out: pairs of ray and primitive that it offers to the query.
"""
