"""What paths are inside of, as they cross surfaces one after the other."""

from __future__ import annotations

import numpy as np

from raytracer.media.stack import NOTHING, MediaIndex, join_stacks, start_outside

# Objects 0, 2 and 5 have media: of materials 1, 0 and 1 of two.
INDEX = MediaIndex(np.array([1, 4, 11]), 2, np.array([False, True]))


def test_media_are_found_behind_their_own_materials() -> None:
    instance, material = np.array([0, 0, 2, 5, 5, 7]), np.array([1, 0, 0, 1, 0, 1])
    assert INDEX.find(instance, material).tolist() == [0, NOTHING, 1, 2, NOTHING, NOTHING]
    assert MediaIndex(np.zeros(0, np.int64), 2, INDEX.is_border).find(instance, material).tolist() == [NOTHING] * 6


def cross(stack, instance, material, front, crosses=True):
    return stack.cross(*(np.array([value]) for value in (instance, material, front, crosses)))


def test_paths_go_in_and_out_in_any_order() -> None:
    stack = start_outside(INDEX, 1)
    stack = cross(stack, 2, 0, True)
    stack = cross(stack, 0, 1, True)
    assert sorted(stack.inside[0]) == [NOTHING, 0, 1]
    assert sorted(cross(stack, 0, 1, True).inside[0]) == [NOTHING, 0, 1]  # again: nothing new
    assert sorted(cross(stack, 5, 1, True, False).inside[0]) == [NOTHING, 0, 1]  # reflected
    stack = cross(stack, 2, 0, False)
    assert sorted(stack.inside[0]) == [NOTHING, NOTHING, 0]
    assert sorted(cross(stack, 5, 1, False).inside[0]) == [NOTHING, NOTHING, 0]  # out of what it is not in
    assert sorted(cross(cross(stack, 5, 1, True), 2, 0, True).inside[0]) == [0, 1, 2]


def test_what_is_full_takes_no_more_and_stacks_are_joined() -> None:
    stack = start_outside(INDEX, 2)
    stack.inside[0] = (2, 2, 2)
    crossed = stack.cross(*(np.array(values) for values in ([0, 0], [1, 1], [True, True], [True, True])))
    assert crossed.inside.tolist() == [[2, 2, 2], [0, NOTHING, NOTHING]]
    joined = join_stacks([crossed, None, crossed.select(np.array([1]))])
    assert joined is not None
    assert len(joined) == 3
    assert join_stacks([None]) is None
