"""Processes of our own, and how arrays reach them. Knows nothing of rendering.

In: a function, its arguments and jobs. Out: results in the order of the jobs.
"""
