"""The scene as frozen records of arrays, checked when they are made, and as a file.

In: what an add-on or a script hands over. Out: records that all rooms read and none changes.
"""
