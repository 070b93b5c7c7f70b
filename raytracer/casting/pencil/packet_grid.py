"""Rays that leave one point, in packets of neighbours on their image, each tested against all that is in its tile.

The image is cut into tiles of about as many rays as a packet has; the rays of a tile are packed in order, the last
packet is filled up. Triangles are listed by the tiles that their boxes meet. The edge functions of all pairs of a
packet's rays and its tile's triangles are one product of small matrices, (triangles, 3) and (3, rays), whatever the
rays' places: more pairs than rays near each triangle, but each at a tenth of the price of one that is gathered.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from raytracer.casting.pencil.grids import FLOAT32_ROUNDOFF, PAIR_BLOCK, Found, Grid, Plan, evaluate
from raytracer.casting.pencil.patches import CONSTANT, EDGES, MOST, SLOPE_X, SLOPE_Y, TOLERANCE, Items
from raytracer.casting.pencil.pencil import View

# Rays of a packet, and cells a side of a tile, about one ray a cell.
PACKET, SIDE = 24, 4
# Tiles are numbered in 16 bits, which are sorted several times faster than 32.
MOST_TILES = 1 << 16
# Triangles of a tile are filled up to one of these numbers; more are tested in parts.
WIDTHS = np.array([2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128])


class Listed(NamedTuple):
    """m pairs of an item and a tile, by tiles.

    item : (m,) row of `items`; entries : (3, m + most, 4), `_make_entries`
    start, stop : (tiles,) where each tile's are
    """

    items: Items
    item: NDArray[np.int32]
    entries: NDArray[np.float32]
    start: NDArray[np.intp]
    stop: NDArray[np.intp]


class PacketGrid(Grid):
    """k packets of a view's rays; a place is a packet's number, and k times a ray's number within it.

    place : (n,) int32 of each ray; ray : (places,) rays
    x, y : (places,) float32, NaN where there is no ray
    tile_of : (k,) int32, each packet's tile
    local : (k, 3, PACKET) float32, rows 1, x and y, from the tile's corner
    """

    inclusive = False
    tile = SIDE

    def __init__(self, view: View) -> None:
        image = view.image
        self.tiles_x, self.tiles_y = _count_tiles(image.shape[1], view)
        wide, high = self.tiles_x * SIDE, self.tiles_y * SIDE
        # A little smaller than the grid, so that no ray lies beyond its last cell.
        half = np.array([wide, high]) / 2 * (1 - 2.0**-18)
        super().__init__(view.centre, np.diag([*half, 1.0]) @ view.matrix, view.step, wide, high)
        # Image points are float32 in [-1, 1], off by 2^-28 of the rectangle before; the product rounds once more.
        self.ray_error = float(half.max()) * (FLOAT32_ROUNDOFF / 2 + 2.0**-27 + FLOAT32_ROUNDOFF) * (1 + 2.0**-20)
        points = image * half.astype(np.float32)[:, np.newaxis]
        column, row = ((points - self.low) * np.float32(1 / SIDE)).astype(np.int32)
        np.clip(column, 0, self.tiles_x - 1, out=column)
        np.clip(row, 0, self.tiles_y - 1, out=row)
        self._pack(row * np.int32(self.tiles_x) + column)
        self.x, self.y = np.full((2, len(self.ray)), np.float32(np.nan))
        self.x[self.place], self.y[self.place] = points
        row, column = np.divmod(self.tile_of, np.int32(self.tiles_x))
        self.local = np.ones((len(self.tile_of), 3, PACKET), np.float32)
        self.local[:, 1] = (self.x.reshape(PACKET, -1) - (column * SIDE + self.low[0])).T
        self.local[:, 2] = (self.y.reshape(PACKET, -1) - (row * SIDE + self.low[1])).T

    def _pack(self, tile: NDArray[np.int32]) -> None:
        """Give each ray a place, by tiles (n,)."""
        order = np.argsort(tile.astype(np.uint16), kind="stable")
        count = np.bincount(tile, minlength=self.tiles_x * self.tiles_y)
        packets = -(-count // PACKET)
        self.tile_of = np.repeat(np.arange(len(count), dtype=np.int32), packets)
        tile = tile.take(order)
        rank = np.arange(len(tile), dtype=np.int32) - (np.cumsum(count) - count).astype(np.int32).take(tile)
        packet = (np.cumsum(packets) - packets).astype(np.int32).take(tile) + rank // PACKET
        place = rank % PACKET * np.int32(len(self.tile_of)) + packet
        self.place = np.empty(len(tile), np.int32)
        self.place[order] = place
        self.ray = np.zeros(len(self.tile_of) * PACKET, np.intp)
        self.ray[place] = order

    def spread(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        places = np.full(len(self.ray), np.float32(np.inf))
        places[self.place] = values
        return places

    def name_rays(self, place: NDArray[np.int32]) -> NDArray[np.intp]:
        return self.ray.take(place)

    def limit_tiles(self) -> NDArray[np.float32]:
        tiles = np.full(self.tiles_x * self.tiles_y, np.float32(np.inf))
        np.minimum.at(tiles, self.tile_of, self.limit.reshape(PACKET, -1).min(axis=0))
        return tiles.reshape(self.tiles_y, self.tiles_x)

    def plan(self, first: NDArray[np.float32], last: NDArray[np.float32]) -> Plan:
        """Notes are the tiles that each box meets, in blocks: low corner and counts, (2, n) int32 each."""
        low, high = (first * np.float32(1 / SIDE)).astype(np.int32), (last * np.float32(1 / SIDE)).astype(np.int32)
        extent = last - first
        # A tile that meets the box ends at most one less than its side beyond it.
        reach = np.maximum(extent[0], extent[1]) + np.float32(1 + SIDE)
        return Plan(np.arange(first.shape[1]), reach, (low, high - low + np.int32(1)))

    def plan_tiles(self, column: NDArray[np.intp], row: NDArray[np.intp]) -> Plan:
        low = np.stack([column, row]).astype(np.int32)
        return Plan(np.arange(len(column)), np.full(len(column), np.float32(SIDE)), (low, np.ones_like(low)))

    def test(self, items: Items, plan: Plan) -> list[Found]:
        item, tile = self._list_tiles(*plan.notes)
        limit = self.limit_tiles().ravel()
        seen = np.flatnonzero((items.rows[MOST].take(item) >= limit.take(tile)) & (limit.take(tile) < np.inf))
        item, tile = item.take(seen), tile.take(seen)
        order = np.argsort(tile.astype(np.uint16), kind="stable")
        item, tile = item.take(order), tile.take(order)
        count = np.bincount(tile, minlength=len(limit))
        stop = np.cumsum(count)
        listed = Listed(items, item, self._make_entries(items, item, tile), stop - count, stop)
        return [self._test_packets(listed, *group) for group in self._group(count)]

    def _list_tiles(self, low: NDArray[np.int32], count: NDArray[np.int32]) -> tuple[NDArray, NDArray]:
        """All pairs of an item and a tile that its box meets."""
        number = count[0] * count[1]
        item = np.repeat(np.arange(len(number), dtype=np.int32), number)
        step = np.arange(len(item), dtype=np.int32) - (np.cumsum(number, dtype=np.int32) - number).take(item)
        across = count[0].take(item)
        row = step // across
        return item, (low[1].take(item) + row) * np.int32(self.tiles_x) + low[0].take(item) + step - row * across

    def _make_entries(self, items: Items, item: NDArray[np.int32], tile: NDArray[np.int32]) -> NDArray[np.float32]:
        """(3 edges, m + most, 4) c + tolerance, c_x and c_y of items in tiles, from the tile's corner, and nothing, for
        rows of 16 bytes are gathered at twice the speed of 12; then as many that are never met as a packet may meet
        at once.

        E + tolerance >= 0 is what is asked, so that nothing need be compared with the tolerance of each pair.
        """
        rows = items.rows
        row, column = np.divmod(tile, np.int32(self.tiles_x))
        right, up = column * np.float32(SIDE) + self.low[0], row * np.float32(SIDE) + self.low[1]
        right -= items.base[0].take(item)
        up -= items.base[1].take(item)
        tolerance = rows[TOLERANCE].take(item)
        entries = np.zeros((EDGES, len(item) + WIDTHS[-1], 4), np.float32)
        entries[:, len(item) :, 0] = -1.0
        for edge, entry in enumerate(entries[:, : len(item)]):
            constant, slope_x, slope_y = (rows[row + edge].take(item) for row in (CONSTANT, SLOPE_X, SLOPE_Y))
            entry[:, 1], entry[:, 2] = slope_x, slope_y
            constant += np.multiply(slope_x, right, out=slope_x)
            constant += np.multiply(slope_y, up, out=slope_y)
            constant += tolerance
            entry[:, 0] = constant
        return entries

    def _group(self, count: NDArray[np.intp]) -> Iterator[tuple[NDArray[np.intp], int, int]]:
        """Yield packets whose tiles list about as many items, how many that is at most, and which is the first."""
        offset, left = 0, count.take(self.tile_of)
        while True:
            waiting = np.flatnonzero(left > 0)
            if not len(waiting):
                return
            kind = np.searchsorted(WIDTHS, np.minimum(left.take(waiting), WIDTHS[-1]))
            for one in np.flatnonzero(np.bincount(kind)):
                width = int(WIDTHS[one])
                yield waiting.take(np.flatnonzero(kind == one)), width, offset
            offset, left = offset + int(WIDTHS[-1]), left - WIDTHS[-1]

    def _test_packets(self, listed: Listed, packet: NDArray[np.intp], width: int, offset: int) -> Found:
        """Pairs of packets' rays and some of the items of their tiles."""
        tile = self.tile_of.take(packet)
        first = listed.start.take(tile) + offset
        pair, least = self._cross(listed, packet, first, width)
        slot = pair // PACKET
        row = slot // width
        entry = first.take(row) + slot - row * width
        # Beyond a tile's own follow those of the next.
        own = np.flatnonzero(entry < listed.stop.take(tile).take(row))
        item = listed.item.take(entry.take(own))
        place = (pair - slot * PACKET).take(own) * len(self.tile_of) + packet.take(row.take(own))
        items = listed.items
        inside = least.take(own) > 2 * items.rows[TOLERANCE].take(item)
        x, y = self.x.take(place) - items.base[0].take(item), self.y.take(place) - items.base[1].take(item)
        return Found(place.astype(np.int32), item, inside, evaluate(items.rows, EDGES, item, x, y))

    def _cross(
        self, listed: Listed, packet: NDArray[np.intp], first: NDArray[np.intp], width: int
    ) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
        """Places in (packets, width, PACKET) of pairs that may meet, and their least edge function with tolerance."""
        found = []
        size, step = max(1, PAIR_BLOCK // (PACKET * width)), np.arange(width)
        for start in range(0, len(packet), size):
            slots = first[start : start + size, np.newaxis] + step
            functions = np.empty((len(slots), EDGES, width, 4), np.float32)
            for edge, entry in enumerate(listed.entries):
                functions[:, edge] = entry.take(slots, axis=0)
            local = self.local.take(packet[start : start + size], axis=0)
            value = np.matmul(functions.reshape(len(slots), -1, 4)[:, :, :3], local)
            value = value.reshape(len(slots), EDGES, -1)
            least = np.minimum(value[:, 0], value[:, 1])
            np.minimum(least, value[:, 2], out=least)
            pair = np.flatnonzero(least >= 0)
            found.append((pair + start * width * PACKET, least.ravel().take(pair)))
        pair, least = (np.concatenate(column) for column in zip(*found, strict=True))
        return pair, least


def _count_tiles(count: int, view: View) -> tuple[int, int]:
    """Columns and rows of square tiles, about a packet each."""
    width, height = (1.0 / np.linalg.norm(np.cross(row, view.matrix[2])) for row in view.matrix[:2])
    most = min(max(1.0, count / SIDE**2), MOST_TILES)
    wide = int(np.clip(np.sqrt(most * width / height), 1, most))
    return wide, max(1, int(most) // wide)
