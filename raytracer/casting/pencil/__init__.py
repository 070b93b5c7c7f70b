"""Rays that meet in a point or run parallel: candidates by projection onto a screen.

In: a query whose rays form a pencil. Out: pairs of ray and primitive, offered or settled.
"""
