"""The variables of MAT files of both kinds as plain trees: arrays, texts, dicts for structs, lists for cells.

A file of level 5 is checked first, since scipy trusts the lengths in it. Its layout is that of "MAT-File Format" (The
MathWorks, 2023), chapter 1: elements of a tag (type, length) and data, padded to 8 bytes; a matrix is an element of
elements: flags, dimensions, name, then data by its class.
"""

import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import h5py

HDF = b"\x89HDF\r\n\x1a\n"
DEEPEST = 20  # structs in structs; a damaged file may hold itself


@dataclass(frozen=True)
class Opaque:
    """An object of a MATLAB class, which only MATLAB can take apart."""

    kind: str


@dataclass(frozen=True)
class Cells:
    """A cell array."""

    entries: list[Any]


Tree = Any  # np.ndarray | str | dict[str, Tree] | list[dict[str, Tree]] | Cells | Opaque


def is_hdf(path: Path) -> bool:
    """Whether a MAT file is of version 7.3: HDF5 behind a block of 512 bytes, or none."""
    with path.open("rb") as file:
        head = file.read(1024)
    return head.startswith(HDF) or head[512:520] == HDF or (head.startswith(b"MATLAB 7.3") and head[126:128] == b"IM")


def variables_of_5(path: Path) -> dict[str, Tree]:
    """The variables of a file up to version 7."""
    check_level_5(path)
    variables = {}
    for name, value in load_5(path).items():
        if name == "None":  # objects have no name in their head; the last of them stands for all
            variables[_text(value.ravel()[0]["s0"])] = _from_5(value)
        elif not name.startswith("__"):
            variables[name] = _from_5(value)
    return variables


def load_5(path: Path, names: list[str] | None = None) -> dict[str, Any]:
    """What scipy reads, all or only the variables `names`; its warnings are about damaged or doubled variables."""
    from scipy.io import loadmat

    with warnings.catch_warnings(record=True) as messages:
        warnings.simplefilter("always")
        content = loadmat(path, variable_names=names)
    for warning in messages:
        if 'name "None"' not in str(warning.message):  # which all objects have
            raise ValueError(str(warning.message))
    return content


def _from_5(value: Any, depth: int = 0) -> Tree:
    """What scipy makes of a variable as a tree."""
    from scipy.io import matlab

    if depth > DEEPEST:
        raise ValueError("nested too deep")
    if isinstance(value, matlab.MatlabOpaque):
        return Opaque(_text(value.ravel()[0]["s2"]))
    if isinstance(value, matlab.MatlabFunction):
        return Opaque("function_handle")
    if not isinstance(value, np.ndarray):
        return value.toarray() if hasattr(value, "toarray") else value
    if value.dtype.names:
        names = value.dtype.names
        entries = [{name: _from_5(entry[name], depth + 1) for name in names} for entry in value.ravel(order="F")]
        return entries[0] if len(entries) == 1 else entries
    if value.dtype.kind == "O":
        return Cells([_from_5(entry, depth + 1) for entry in value.ravel(order="F")])
    if value.dtype.kind == "U":
        return "\n".join(map(str, value.ravel()))
    return value


def _text(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def variables_of_73(path: Path) -> dict[str, Tree]:
    """The variables of a file of version 7.3. MATLAB stores arrays by columns, so HDF5 shows them transposed."""
    import h5py

    with h5py.File(path, "r") as file:
        return dict(_members(file, file, 0))


def _members(file: "h5py.File", group: "h5py.Group", depth: int) -> Iterator[tuple[str, Tree]]:
    if depth > DEEPEST:
        raise ValueError("nested too deep")
    for name in group:
        if not name.startswith("#"):  # #refs# and #subsystem# are MATLAB's own
            yield name, _from_73(file, group[name], depth)


def _from_73(file: "h5py.File", node: Any, depth: int) -> Tree:
    """A node of HDF5 as a tree."""
    import h5py

    kind = _text(node.attrs.get("MATLAB_class", b""))
    if "MATLAB_object_decode" in node.attrs:
        return Opaque(kind or "object")
    if isinstance(node, h5py.Group):
        if kind not in ("", "struct"):
            return Opaque(kind)
        members = dict(_members(file, node, depth + 1))
        counts = {len(member.entries) for member in members.values() if isinstance(member, Cells)}
        # A struct array keeps one list of references a field; a field that is a cell array is a cell of class `cell`.
        structs = len(counts) == 1 and all(isinstance(entry, Cells) for entry in members.values()) and members
        if structs and not any(_text(node[name].attrs.get("MATLAB_class", b"")) == "cell" for name in members):
            return [{name: entry.entries[k] for name, entry in members.items()} for k in range(counts.pop())]
        return members
    if node.attrs.get("MATLAB_empty"):
        return "" if kind == "char" else np.empty((0, 0))
    if h5py.check_ref_dtype(node.dtype):
        if depth > DEEPEST:
            raise ValueError("nested too deep")
        return Cells([_from_73(file, file[reference], depth + 1) for reference in np.asarray(node).ravel()])
    values = np.asarray(node[()]).T
    if kind == "char":
        return "".join(map(chr, values.ravel(order="F")))
    if values.dtype.names == ("real", "imag"):
        return values["real"] + 1j * values["imag"]
    return values


def describe_tree(tree: Tree) -> str:
    """What a variable is, for messages."""
    if isinstance(tree, Opaque):
        return f"{tree.kind} object"
    if isinstance(tree, Mapping):
        return "struct 1x1"
    if isinstance(tree, list):
        return f"struct 1x{len(tree)}"
    if isinstance(tree, Cells):
        return f"cell of {len(tree.entries)}"
    if isinstance(tree, np.ndarray):
        return f"{'complex' if tree.dtype.kind == 'c' else 'numeric'} {'x'.join(map(str, tree.shape))}"
    return "text"


MATRIX, COMPRESSED = 14, 15
SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}  # bytes of a number by its type
LETTERS = {1: 1, 2: 1, 4: 2, 16: 1, 17: 2, 18: 4}
CELL, STRUCT, OBJECT, CHAR, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
NUMERIC = range(6, 16)
COMPLEX = 0x08  # in the flags
DEEPEST_MATRIX = 50


def check_level_5(path: Path) -> None:
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
        """Raises ValueError if the parts of the matrix do not fit together."""
        if not self.data:
            return
        if self.depth > DEEPEST_MATRIX:
            raise ValueError("nested too deep")
        flags = self._next({6})
        kind, bits = (flags[0], flags[1]) if self.order == "<" else (flags[3], flags[2])
        if kind == OPAQUE:
            return
        shape = self._integers(self._next({5}))
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

    def _integers(self, data: bytes) -> list[int]:
        if len(data) % 4:
            raise ValueError("a whole number is cut")
        return list(struct.unpack(f"{self.order}{len(data) // 4}i", data))

    def _fields(self, kind: int) -> int:
        """Number of fields of a struct."""
        if kind == OBJECT:
            self._next({1, 2, 16})  # the name of its class
        (width,) = self._integers(self._next({5})) or [0]
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
        """Raises ValueError if rows, columns and values of a sparse matrix do not fit together."""
        rows, starts = self._integers(self._next({5})), self._integers(self._next({5}))
        rising = all(a <= b for a, b in pairwise(starts))
        if len(shape) != 2 or len(starts) != shape[1] + 1 or starts[0] != 0 or not rising or starts[-1] > len(rows):
            raise ValueError("impossible columns of a sparse matrix")
        if rows[: starts[-1]] and not 0 <= min(rows[: starts[-1]]) <= max(rows[: starts[-1]]) < shape[0]:
            raise ValueError("impossible rows of a sparse matrix")
        for _ in range(2 if twice else 1):
            data = self._next(set(SIZES))
            if len(data) < starts[-1] * SIZES[self.kind]:
                raise ValueError("too few values of a sparse matrix")
