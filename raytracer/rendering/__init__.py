"""Pictures: blocks of pixels over processes, progress, the viewport's refinement.

In: a scene and settings. Out: a `Film`.
"""
