"""The camera's film: where rays start, how samples become pixels, and which passes there are.

In: what the samples saw. Out: pictures by the names of their passes.
"""
