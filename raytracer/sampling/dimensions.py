"""Who takes which numbered dimension of the sample points: the one table.

A camera ray takes the last two numbers, the choice of pixels the one before them, and what is cast for passes alone,
and its time, those before that. Its path takes those from 0 on, wave after wave, each wave as many as `WaveDimensions`
says. Sets of pixels that share samples have the same numbers again, from SHARED_DIMENSION on. A stage that a picture
lacks leaves its numbers to the next; a source of light that only part of the scene sees keeps them, so that the other
part is sampled alike.

A new use gets its own line here: two uses of one number would be correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

# Where in its pixel a camera ray goes through the film, and where through the lens.
FILTER_DIMENSION = 2**32 - 1
LENS_DIMENSION = 2**32 - 2
# In which sweeps a pixel is sampled, where not all are (`rendering.adaptive`).
ALLOCATION_DIMENSION = 2**32 - 3
# Where rays go that are cast for passes which shaders write.
AOV_DIMENSION = 2**32 - 4
# Where rays go that tell how open it is around a surface.
OCCLUSION_DIMENSION = 2**32 - 5
# When rays leave, where something moves; sets of pixels share it.
TIME_DIMENSION = 2**32 - 6
# Where rays go that look for normals around, for passes which shaders write.
AOV_BEVEL_DIMENSION = 2**32 - 7
# At what rays are aimed, and through what, that look for small light (`rendering.probes`).
SIGHT_DIMENSION = 2**32 - 8
# Dimensions from here on belong to the sets of pixels that share samples.
SHARED_DIMENSION = 2**31


# Whose the pairs are that are good together (`joined_pairs`): where a ray goes through the film and the lens, and where
# light comes from and goes to in the first waves of its path. Other pairs are shuffled.
FILTER_PAIR, FIRST_WAVE_PAIR, LENS_PAIR = 0, 1, 4
JOINED_WAVES = LENS_PAIR - FIRST_WAVE_PAIR


def find_wave_pair(wave: int) -> int | None:
    """Return the pair of a wave, counted from 0; None where it has none.

    Examples
    --------
    >>> [find_wave_pair(wave) for wave in range(5)]
    [1, 2, 3, None, None]
    """
    return FIRST_WAVE_PAIR + wave if wave < JOINED_WAVES else None


# Of a way through media: its distance and channel; random numbers of ways that vary; the lobe and the direction that it
# is scattered to; whether it goes on; two ways to sample the world.
DISTANCE, NOISE, PHASE_LOBE, PHASE_DIRECTION, PHASE_ROULETTE, AROUND, AFTER_MAP = range(7)
MEDIUM_COUNT = 7


@dataclass(frozen=True)
class WaveDimensions:
    """The numbers that the stages of one wave take, counted from the wave's first.

    lobe : which lobe the path goes on by
    direction : where to, within that lobe
    sources : of each source of light, the first of its own
    programs : of rays that shader programs cast, the first; None where no program does
    roulette : whether the path goes on; None where that is not left to chance
    walk : of ways through what is below surfaces, the first; None where there are none
    exit : where those end, what the numbers of a wave count from again
    medium : of ways through media, the first of MEDIUM_COUNT and one for each source; None where there are none
    lit : of the light that is sampled along these ways, what the numbers of a wave count from once more
    count : how many a wave takes in all
    """

    lobe: int
    direction: int
    sources: tuple[int, ...]
    programs: int | None
    roulette: int | None
    count: int
    walk: int | None = None
    exit: int = 0
    medium: int | None = None
    lit: int = 0


def allocate_dimensions(
    source_counts: Sequence[int], programs: int, roulette: bool, walk_count: int = 0, media: bool = False
) -> WaveDimensions:
    """Return the table of a wave.

    source_counts : how many numbers each source of light takes
    programs : how many numbers the rays take that shader programs cast, for each purpose one
    roulette : True where paths end by chance
    walk_count : how many numbers a way through what is below a surface takes; 0 where there are none
    media : True where ways lead through media

    Examples
    --------
    >>> wave = allocate_dimensions([2, 1], programs=1, roulette=True)
    >>> wave.sources, wave.count
    ((2, 4), 7)
    """
    lobe, direction = 0, 1
    *sources, end = accumulate(source_counts, initial=direction + 1)
    count = end + programs + roulette
    wave = WaveDimensions(
        lobe, direction, tuple(sources), end if programs else None, count - 1 if roulette else None, count
    )
    if walk_count:
        wave = replace(wave, walk=count, exit=count + walk_count, count=2 * count + walk_count)
    if media:
        lit = wave.count + MEDIUM_COUNT + len(source_counts)
        wave = replace(wave, medium=wave.count, lit=lit, count=lit + count)
    return wave
