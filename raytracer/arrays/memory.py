"""How the C library keeps memory that arrays gave back."""

from __future__ import annotations

import ctypes
import sys

import numpy as np

# The largest block by whose release glibc learns (DEFAULT_MMAP_THRESHOLD_MAX, 32 MB on 64-bit), less its header.
_LARGEST_LESSON = (32 << 20) - (64 << 10)


def keep_freed_memory() -> None:
    """Make glibc hold on to freed memory up to 64 MB instead of returning it to the system at once.

    Casting works on many arrays of 64 to 512 kB that live for microseconds. glibc asks the system for every block
    above 128 kB, and gives back the heap's end as soon as 128 kB of it are free: each new array then costs page
    faults, which took half of the time of long expressions (57 instead of 19 ns per row of
    `filtered.intersect_plane_certified`, 200 instead of 53 in `refine`). Both limits adapt: the release of a larger
    block raises the first to its size and the second to twice that (mallopt(3), M_MMAP_THRESHOLD). So one block is
    taken and released, untouched. On other systems this does nothing.
    """
    np.empty(_LARGEST_LESSON, np.uint8)


def release_freed_memory() -> None:
    """Give the system back what glibc has held on to, up to some hundred MB after large blocks of rays.

    To have it again takes a page fault for each 4 kB, some 50 ms for 200 MB. On other systems this does nothing.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)
