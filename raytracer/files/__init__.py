"""Files: the one way in which anything is written, arrays in archives, and how a picture is known to be whole.

In: paths. Out: files that are whole, or as they were. Knows nothing of what files hold, so that every room may use it.
"""
