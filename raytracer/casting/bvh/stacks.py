"""Columns of pairs on their way through a traversal: a stack of what is to be opened, a buffer of what waits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Pairs(NamedTuple):
    """Rows with nodes or leaves they enter, or rays with candidates, and the distance from which on."""

    row: NDArray[np.int32]
    target: NDArray
    entry: NDArray[np.float32]

    def select(self, index: NDArray[np.intp]) -> Pairs:
        return Pairs(self.row.take(index), self.target.take(index), self.entry.take(index))

    def part(self, where: slice) -> Pairs:
        return Pairs(self.row[where], self.target[where], self.entry[where])


class Stack:
    """Growing columns of pairs; `pop` returns the top chunk as views."""

    def __init__(self, capacity: int) -> None:
        self.size = 0
        self.columns = Pairs(np.empty(capacity, np.int32), np.empty(capacity, np.int32), np.empty(capacity, np.float32))

    def push(self, pairs: Pairs) -> None:
        end = self.size + len(pairs.row)
        if end > len(self.columns[0]):
            grown = max(end, 2 * len(self.columns[0]))
            self.columns = Pairs(*(np.resize(column, grown) for column in self.columns))
        for column, value in zip(self.columns, pairs, strict=True):
            column[self.size : end] = value
        self.size = end

    def pop(self, count: int, floor: int) -> Pairs:
        start = max(floor, self.size - count)
        chunk = self.columns.part(slice(start, self.size))
        self.size = start
        return chunk


class Buffer:
    """Pairs of rows and leaves that wait to be tested together."""

    def __init__(self) -> None:
        self.parts: list[Pairs] = []
        self.count = 0

    def append(self, pairs: Pairs) -> None:
        self.parts.append(pairs)
        self.count += len(pairs.row)

    def take_all(self) -> Pairs:
        row, target, entry = zip(*self.parts, strict=True)
        pairs = Pairs(np.concatenate(row), np.concatenate(target), np.concatenate(entry))
        self.parts, self.count = [], 0
        return pairs
