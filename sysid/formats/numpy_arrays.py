"""Arrays saved by NumPy."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from sysid.base.errors import InputError
from sysid.data.table import Table
from sysid.formats._arrays import Arrays, describe_array, list_descriptions
from sysid.formats._format import Format


class NumpyArrays(Format):
    """Reads .npz and .npy: every numeric vector is a column, column j (from 1) of a matrix M is called M:j.

    The matrix of a .npy has the columns 1, 2, ... Pickled objects are never loaded, because loading them runs code.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".npy", ".npz")
    written: ClassVar[tuple[str, ...]] = ()
    headed: ClassVar[bool] = False

    @staticmethod
    def libraries(path: Path) -> tuple[str, ...]:
        """The modules that read this file beside numpy: none."""
        return ()

    def read(self, path: Path) -> Table:
        """The vectors in `path`; raises InputError if it is damaged, or holds pickled objects or no numbers."""
        content = _load(path)
        if isinstance(content, np.ndarray):
            names = content.dtype.names
            content = {name: content[name] for name in names} if names else _columns(content)
        arrays = Arrays(path)
        for name, values in content.items():
            arrays.add(name, values)
        message = list_descriptions({name: describe_array(np.asarray(values)) for name, values in content.items()})
        return arrays.table(
            "element", f"has no numeric vector; found {message}; save input and output as vectors with np.savez"
        )


def _load(path: Path) -> Any:
    """The array of a .npy, or the arrays of a .npz by name."""
    kind = path.suffix.lower().removeprefix(".")
    wrong = f"{path} is not a readable {kind} file"
    try:
        with path.open("rb") as file:  # numpy leaves a file open that it fails to read
            content = np.load(file, allow_pickle=False)
            if isinstance(content, np.ndarray) != (kind == "npy"):
                raise InputError(f"{wrong}: its content is that of the other suffix, .npy or .npz; rename it")
            if isinstance(content, np.ndarray):
                return content
            with content:
                for name in content.files:
                    if content.files.count(name) > 1:
                        raise InputError(f"{wrong}: two of its arrays are called {name!r}; save it again")
                return {name: content[name] for name in content.files}
    except (InputError, MemoryError):
        raise
    except Exception as error:  # a damaged file fails in many ways inside numpy and zipfile
        if isinstance(error, OSError) and error.errno:
            raise
        with path.open("rb") as file:
            is_numpy_file = file.read(6).startswith(
                (b"\x80", b"\x93NUMPY", b"PK\3\4")
            )  # numpy takes all else for a pickle
        if is_numpy_file and "allow_pickle" in str(error):
            raise InputError(
                f"{path} holds pickled Python objects, which are never loaded because loading them runs code; "
                "save plain arrays of numbers with np.savez"
            ) from None
        raise InputError(f"{wrong} (it is cut or damaged); save it again with numpy") from None


def _columns(values: np.ndarray) -> dict[str, np.ndarray]:
    if values.ndim != 2:
        return {"1": values}
    samples = values if values.shape[0] >= values.shape[1] else values.T
    return {str(j + 1): samples[:, j] for j in range(samples.shape[1])}
