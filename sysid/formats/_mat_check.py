"""Whether a MAT file of level 5 holds together, so that scipy, which trusts the lengths in it, can be let at it.

The layout is that of "MAT-File Format" (The MathWorks, 2023), chapter 1: elements of a tag (type, length) and
data, padded to 8 bytes; a matrix is an element of elements: flags, dimensions, name, then data by its class.
"""

import struct
import zlib
from itertools import pairwise
from math import prod
from pathlib import Path

MATRIX, COMPRESSED = 14, 15
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # bytes of a number by its type
LETTERS = {1: 1, 2: 1, 4: 2, 16: 1, 17: 2, 18: 4}
CELL, STRUCT, OBJECT, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)
COMPLEX = 0x08  # in the flags
DEEPEST = 50


def check(path: Path) -> None:
    """Raises ValueError if the file is of level 5 and its parts do not fit together."""
    raw = path.read_bytes()
    if raw[:4].count(0) or len(raw) < 128:
        return  # level 4, which has no such parts
    order = {b"IM": "<", b"MI": ">"}.get(raw[126:128])
    if order is None:
        raise ValueError("no mark of its byte order")
    place = 128
    while place < len(raw):
        kind, length = struct.unpack_from(order + "II", raw, place) if place + 8 <= len(raw) else (0, 0)
        data = raw[place + 8 : place + 8 + length]
        if kind not in (MATRIX, COMPRESSED) or len(data) < length:
            raise ValueError("an element is cut or of no known type")
        if kind == COMPRESSED:
            data = zlib.decompress(data)  # zlib.error is none of ValueError's; the caller takes both
            kind, inner = struct.unpack_from(order + "II", data)
            if kind != MATRIX or len(data) < 8 + inner:
                raise ValueError("a compressed element is no matrix")
            data = data[8 : 8 + inner]
        _Matrix(data, order, 0).check()
        place += 8 + length


class _Matrix:
    def __init__(self, data: bytes, order: str, depth: int) -> None:
        self.data, self.order, self.depth, self.place = data, order, depth, 0

    def check(self) -> None:
        if not self.data:
            return
        if self.depth > DEEPEST:
            raise ValueError("nested too deep")
        flags = self._next({6})
        kind, bits = (flags[0], flags[1]) if self.order == "<" else (flags[3], flags[2])
        if kind == OPAQUE:
            return
        shape = self._whole(self._next({5}))
        if len(shape) < 2 or min(shape) < 0:
            raise ValueError("impossible dimensions")
        self._next({1, 2, 16})  # the name
        count = prod(shape)
        if kind in (STRUCT, OBJECT):
            count *= self._fields(kind)
        if kind in (CELL, STRUCT, OBJECT, FUNCTION):
            for _ in range(1 if kind == FUNCTION else count):
                _Matrix(self._next({MATRIX}), self.order, self.depth + 1).check()
        elif kind == CHAR:
            self._numbers(count, LETTERS, exact=False)
        elif kind == SPARSE:
            self._sparse(shape, bool(bits & COMPLEX))
        elif kind in NUMERIC:
            for _ in range(2 if bits & COMPLEX else 1):
                self._numbers(count, SIZES)
        else:
            raise ValueError(f"a matrix of class {kind}")

    def _next(self, kinds: set[int]) -> bytes:
        """Data of the next element, which has one of these types; its type is kept in `kind`."""
        if self.place + 8 > len(self.data):
            raise ValueError("a matrix is cut")
        first, length = struct.unpack_from(self.order + "II", self.data, self.place)
        small = first >> 16  # up to 4 bytes stand in the tag itself
        self.kind, length = (first & 0xFFFF, small) if small else (first, length)
        start = self.place + (4 if small else 8)
        self.place = self.place + 8 if small else start + length + (-length % 8 if self.kind != COMPRESSED else 0)
        if self.kind not in kinds or start + length > len(self.data) or (small and length > 4):
            raise ValueError("an element is cut or of another type")
        return self.data[start : start + length]

    def _whole(self, data: bytes) -> list[int]:
        if len(data) % 4:
            raise ValueError("a whole number is cut")
        return list(struct.unpack(f"{self.order}{len(data) // 4}i", data))

    def _fields(self, kind: int) -> int:
        """Number of fields of a struct."""
        if kind == OBJECT:
            self._next({1, 2, 16})  # the name of its class
        (width,) = self._whole(self._next({5})) or [0]
        names = self._next({1, 2, 16})
        if width < 1 or len(names) % width:
            raise ValueError("impossible names of fields")
        return len(names) // width

    def _numbers(self, count: int, sizes: dict[int, int], exact: bool = True) -> bytes:
        data = self._next(set(sizes))
        size = sizes[self.kind]
        if len(data) % size or (len(data) != count * size if exact or size > 1 else len(data) < count):
            raise ValueError("another number of elements than its dimensions say")
        return data

    def _sparse(self, shape: list[int], twice: bool) -> None:
        rows, starts = self._whole(self._next({5})), self._whole(self._next({5}))
        rising = all(a <= b for a, b in pairwise(starts))
        if len(shape) != 2 or len(starts) != shape[1] + 1 or starts[0] != 0 or not rising or starts[-1] > len(rows):
            raise ValueError("impossible columns of a sparse matrix")
        if rows[: starts[-1]] and not 0 <= min(rows[: starts[-1]]) <= max(rows[: starts[-1]]) < shape[0]:
            raise ValueError("impossible rows of a sparse matrix")
        for _ in range(2 if twice else 1):
            data = self._next(set(SIZES))
            if len(data) < starts[-1] * SIZES[self.kind]:
                raise ValueError("too few values of a sparse matrix")
