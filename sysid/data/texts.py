"""Texts: the cells of a column of a long file, without a Python string for each."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base import tables

if TYPE_CHECKING:
    import polars

MANY = 1 << 16  # cells that are Python strings at a time


class Texts(Sequence[str]):
    """Texts (n,) that polars holds; each is made a Python string when it is asked for."""

    def __init__(self, series: "polars.Series") -> None:
        self._series = series

    def __len__(self) -> int:
        return len(self._series)

    def __getitem__(self, k: Any) -> Any:
        return self._series[k].to_list() if isinstance(k, slice) else self._series[int(k)]

    def __iter__(self) -> Iterator[str]:
        for start in range(0, len(self), MANY):
            yield from self._series[start : start + MANY].to_list()

    def taken(self, rows: np.ndarray) -> "Texts":
        """The texts of some rows (m,)."""
        return Texts(self._series.gather(rows))

    def numbers(self, decimal: str = ".") -> np.ndarray:
        """The cells (n,) as float64 as Python reads them; nan for one that is no number."""
        import polars

        tables.check_fork()
        texts = self._series
        if decimal == ",":
            texts = texts.str.replace_all(",", ".", literal=True)
        texts = texts.str.strip_chars()
        values = texts.cast(polars.Float64, strict=False)
        odd = values.is_null()
        found = values.to_numpy(writable=True)
        if odd.any():  # empty, no number, or one that Python alone reads, such as digits of other alphabets
            others = {text: number for text in texts.filter(odd).unique() if (number := _number(text)) is not None}
            if others:
                places = np.flatnonzero(odd.to_numpy())
                found[places] = [others.get(texts[int(k)], np.nan) for k in places]
        return found


def is_number(text: str) -> bool:
    """Whether a cell is a number (nan and inf count, although they are not usable)."""
    return _number(text) is not None


def _number(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)
    except ValueError:
        return None
