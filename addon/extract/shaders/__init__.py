"""Shader node trees to materials and programs.

In: a material's or world's nodes. Out: closures whose parameters are constants or registers of a program.
"""
