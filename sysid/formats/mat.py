"""MATLAB files: up to version 7 by scipy, of version 7.3 (HDF5) by h5py."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sysid.data.table import Table
from sysid.formats._arrays import Arrays, list_descriptions, squeeze
from sysid.formats._groups import damage
from sysid.formats._mat_tree import Cells, Opaque, Tree, describe_tree, is_hdf, load_5, variables_of_5, variables_of_73

HEADER = "qpal"


class Mat:
    """Reads .mat: every numeric vector is a column; column j (from 1) of a matrix M is called M:j.

    A field f of a struct s is called s.f, in a struct array s(k).f, entry k (from 1) of a cell array c{k}. Of what
    Simulink calls Structure With Time each signal is a column under its label, beside the column s.time. Single numbers
    and texts are `meta`. Objects such as timeseries are opaque outside MATLAB and are left out with a note on what to
    do. Writes each column as a column vector, and the header as the text `qpal`.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    written: ClassVar[tuple[str, ...]] = (".mat",)
    headed: ClassVar[bool] = True

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """The modules that read this file, loaded once for many files."""
        return ("h5py",) if is_hdf(path) else ("scipy.io",)

    def read(self, path: Path) -> Table:
        """The vectors in `path`; raises InputError if it is not a MAT file, is damaged, or has no vector."""
        hdf = is_hdf(path)
        variables = _variables(path, hdf)
        arrays = Arrays(path)
        for name, tree in variables.items():
            if name != HEADER:
                _add(arrays, name, tree)
        objects = {name: tree.kind for name, tree in variables.items() if isinstance(tree, Opaque)}
        if objects:
            name = next(iter(objects))
            remedy = f"in MATLAB take it apart, as in t = {name}.Time; y = {name}.Data; and save t and y"
            message = list_descriptions({name: f"{kind} object" for name, kind in objects.items()})
            arrays.notes.append(f"{message} cannot be read outside MATLAB; {remedy}")
        else:
            remedy = "save input and output as vectors"
        message = list_descriptions({name: describe_tree(tree) for name, tree in variables.items()})
        return arrays.table("element", f"has no numeric vector; found {message}; {remedy}")

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Columns (N,) by name, and the header."""
        from scipy.io import savemat

        savemat(path, {**columns, HEADER: header}, oned_as="column")

    def header(self, path: Path) -> str:
        """The text `qpal` of the file."""
        if is_hdf(path):
            return ""  # no file that `write` made
        text = load_5(path, [HEADER]).get(HEADER)
        return str(text.ravel()[0]) if isinstance(text, np.ndarray) and text.dtype.kind == "U" and text.size else ""


def _variables(path: Path, hdf: bool) -> dict[str, Tree]:
    """The variables of the file by name; raises InputError for a damaged file."""
    with damage(path, "MAT 7.3" if hdf else "MAT", "save it again from MATLAB with -v7"):
        return variables_of_73(path) if hdf else variables_of_5(path)


def _add(arrays: Arrays, name: str, tree: Tree) -> None:
    """Adds a tree to the arrays, its parts under names that say where they were."""
    if isinstance(tree, dict):
        if not _add_structure_with_time(arrays, name, tree):
            for field, member in tree.items():
                _add(arrays, f"{name}.{field}", member)
    elif isinstance(tree, list):
        _add_struct_array(arrays, name, tree)
    elif isinstance(tree, Cells):
        for k, entry in enumerate(tree.entries, start=1):
            _add(arrays, f"{name}{{{k}}}", entry)
    elif isinstance(tree, Opaque):
        pass  # told once, with what to do
    elif isinstance(tree, str):
        arrays.meta[name] = tree
    else:
        arrays.add(name, tree)


def _add_struct_array(arrays: Arrays, name: str, entries: list[dict[str, Tree]]) -> None:
    """A list of structs: fields of single numbers are columns, as in a list of samples; beside vectors, meta."""
    fields = list(entries[0]) if entries else []
    vectors = [sum(isinstance(value, np.ndarray) and value.size > 1 for value in entry.values()) for entry in entries]
    are_records = bool(entries) and min(vectors) > 1
    for field in fields:
        values = [entry[field] for entry in entries]
        if not are_records and all(
            isinstance(value, np.ndarray) and value.size == 1 and value.dtype.kind in "biuf" for value in values
        ):
            arrays.add(f"{name}.{field}", np.array([value.ravel()[0] for value in values], dtype=float))
        else:
            for k, value in enumerate(values, start=1):
                _add(arrays, f"{name}({k}).{field}", value)


def _add_structure_with_time(arrays: Arrays, name: str, tree: dict[str, Tree]) -> bool:
    """Adds what Simulink logs as Structure With Time: time (N,), signals with values (N, width) or (w1, w2, N)."""
    time, signals = tree.get("time"), tree.get("signals")
    signals = [signals] if isinstance(signals, dict) else signals.entries if isinstance(signals, Cells) else signals
    if not isinstance(time, np.ndarray) or not isinstance(signals, list) or not signals:
        return False
    if any(not isinstance(signal, dict) or "values" not in signal for signal in signals):
        return False
    if time.size:  # empty where the model logs without time
        arrays.column(f"{name}.time", time.ravel())
        arrays.units[f"{name}.time"] = "s"
    before = set(arrays.columns)
    labels = [_label(signal.get("label"), k, len(signals)) for k, signal in enumerate(signals, start=1)]
    for k, (label, signal) in enumerate(zip(labels, signals, strict=True), start=1):
        values = signal["values"]
        column = f"{name}.{label if labels.count(label) == 1 and label != 'time' else f'signals({k})'}"
        if isinstance(values, np.ndarray) and values.ndim == 3 and squeeze(values).ndim > 1:
            values = values.reshape(-1, values.shape[2], order="F").T
        if isinstance(values, np.ndarray) and values.ndim == 2 and values.shape[1] > 1 and len(values) == time.size:
            for j in range(values.shape[1]):  # by time, even where fewer samples than signals were taken
                arrays.column(f"{column}:{j + 1}", values[:, j])
        else:
            _add(arrays, column, values)
    if time.size:
        arrays.clocks |= {column: f"{name}.time" for column in arrays.columns if column not in before}
    return True


def _label(label: Any, k: int, count: int) -> str:
    return label.strip() if isinstance(label, str) and label.strip() else f"signals({k})" if count > 1 else "signals"
