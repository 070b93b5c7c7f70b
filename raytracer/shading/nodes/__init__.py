"""Shader nodes as functions on arrays, a module for each kind; `shading.evaluate` runs them."""
