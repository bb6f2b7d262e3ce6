"""MATLAB files up to version 7."""

from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table

HEADER = "qpal"


class Mat:
    """Reads .mat: every numeric vector is a column; column j (from 1) of a matrix M is called M:j.

    Writes each column as a column vector, and the header as the text `qpal`.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    written: ClassVar[tuple[str, ...]] = (".mat",)
    headed: ClassVar[bool] = True

    def read(self, path: Path) -> Table:
        """The vectors in `path`; raises InputError if it is not a MAT file, is of version 7.3, or has no vector."""
        from scipy.io import loadmat

        try:
            content = loadmat(path)
        except NotImplementedError:
            raise InputError(
                f"{path} is a MAT file of version 7.3 (HDF5), which is not read here; save it again with -v7"
            ) from None
        except OSError:
            raise
        except Exception as error:  # a damaged file fails in many ways inside scipy: each of them is the file's fault
            kind = type(error).__name__
            raise InputError(
                f"{path} is not a readable MAT file ({kind}); save it again from MATLAB with -v7"
            ) from None
        variables = {name: value for name, value in content.items() if not name.startswith("__")}
        columns: dict[str, np.ndarray] = {}
        for name, value in variables.items():
            columns.update(_vectors(name, value))
        if not columns:
            found = ", ".join(f"{name} ({_describe(value)})" for name, value in variables.items()) or "nothing"
            raise InputError(f"{path} has no numeric vector; found {found}; save input and output as vectors")
        rows = tuple(range(1, len(values) + 1) for values in columns.values())
        return Table(path, tuple(columns), tuple(columns.values()), rows, place="element")

    def write(self, path: Path, columns: Mapping[str, np.ndarray], header: str) -> None:
        """Columns (N,) by name, and the header."""
        from scipy.io import savemat

        savemat(path, {**columns, HEADER: header}, oned_as="column")

    def header(self, path: Path) -> str:
        """The text `qpal` of the file."""
        from scipy.io import loadmat

        text = loadmat(path, variable_names=[HEADER]).get(HEADER)
        return "" if text is None or text.size == 0 else str(text.ravel()[0])


def _vectors(name: str, value: object) -> dict[str, np.ndarray]:
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "biuf" or value.ndim != 2 or value.size < 2:
        return {}
    if min(value.shape) == 1:
        return {name: value.ravel()}
    samples = value if value.shape[0] >= value.shape[1] else value.T
    return {f"{name}:{j + 1}": samples[:, j] for j in range(samples.shape[1])}


def _describe(value: object) -> str:
    if not isinstance(value, np.ndarray):
        return type(value).__name__
    kind = {"c": "complex", "O": "cell", "V": "struct", "U": "text"}.get(value.dtype.kind, "numeric")
    return f"{kind} {'x'.join(str(n) for n in value.shape)}"
