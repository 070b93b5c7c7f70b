"""A Blender of our own beside the user's: what runs there adds nothing to the open file.

No module here imports what orders it.
"""
