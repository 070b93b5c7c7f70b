"""What every room knows of NumPy arrays: types for annotations, rows, vectors, checks of input, the allocator.

In: arrays. Out: arrays. Knows nothing of scenes or rays.
"""
