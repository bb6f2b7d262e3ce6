"""The variables of MAT files of both kinds as plain trees: arrays, texts, dicts for structs, lists for cells."""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.formats._mat_check import check

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
    check(path)
    found = {}
    for name, value in load_5(path).items():
        if name == "None":  # objects have no name in their head; the last of them stands for all
            found[_text(value.ravel()[0]["s0"])] = _from_5(value)
        elif not name.startswith("__"):
            found[name] = _from_5(value)
    return found


def load_5(path: Path, names: list[str] | None = None) -> dict[str, Any]:
    """What scipy reads, all or only the variables `names`; its warnings are about damaged or doubled variables."""
    from scipy.io import loadmat

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        content = loadmat(path, variable_names=names)
    for warning in said:
        if 'name "None"' not in str(warning.message):  # which all objects have
            raise ValueError(str(warning.message))
    return content


def _from_5(value: Any, depth: int = 0) -> Tree:
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
        many = len(counts) == 1 and all(isinstance(each, Cells) for each in members.values()) and members
        if many and not any(_text(node[name].attrs.get("MATLAB_class", b"")) == "cell" for name in members):
            return [{name: each.entries[k] for name, each in members.items()} for k in range(counts.pop())]
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


def described(tree: Tree) -> str:
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
