"""Sample points: scrambled Sobol sequences, who takes which dimension, and warps of the unit square.

In: pixel, sample number, seed, dimension. Out: points, the same for any block, border and number of workers.
"""
