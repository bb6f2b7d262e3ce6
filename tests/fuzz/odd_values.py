"""Values that nobody means as an argument, and some that are fine where a number of another type is."""

from datetime import UTC, date, datetime
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np


def odd() -> dict[str, Any]:
    """Every value by what it is called, made anew: some are used up by a call."""
    import pandas

    n = 200
    return {
        "None": None,
        "True": True,
        "0": 0,
        "1": 1,
        "-1": -1,
        "3": 3,
        "1e9 whole": 10**9,
        "1e30 whole": 10**30,
        "-1e30 whole": -(10**30),
        "1e400 whole": 10**400,
        "0.5": 0.5,
        "-0.5": -0.5,
        "1e9": 1e9,
        "1e308": 1e308,
        "-1e308": -1e308,
        "1e-308": 1e-308,
        "nan": float("nan"),
        "inf": float("inf"),
        "-inf": float("-inf"),
        "1j": 1j,
        "empty text": "",
        "text": "text",
        "number as text": "1",
        "bytes": b"x",
        "empty list": [],
        "empty tuple": (),
        "list of floats": [1.0, 2.0, 3.0],
        "list of texts": ["a"],
        "list of None": [None],
        "nested lists": [[1, 2], [3]],
        "empty dict": {},
        "dict": {"a": 1},
        "dict of texts": {"a": "b"},
        "set": {1},
        "object": object(),
        "function": lambda *a: None,
        "type": int,
        "slice": slice(None),
        "np.int64(1)": np.int64(1),
        "np.int64(-1)": np.int64(-1),
        "np.uint8(3)": np.uint8(3),
        "np.float32(0.5)": np.float32(0.5),
        "Fraction": Fraction(1, 2),
        "Decimal": Decimal("0.5"),
        "date": date(2020, 1, 1),
        "datetime": datetime(2020, 1, 1, tzinfo=UTC),
        "Path": Path("nowhere.txt"),
        "empty array": np.empty(0),
        "array 0-d": np.array(1.0),
        "array of 3": np.array([1.0, 2.0, 3.0]),
        "array of 200": np.linspace(-1, 1, n),
        "array of 200 x 1": np.linspace(-1, 1, n)[:, None],
        "array 3-d": np.ones((2, 2, 2)),
        "array of nan": np.full(n, np.nan),
        "array with inf": np.where(np.arange(n) == 7, np.inf, np.linspace(-1, 1, n)),
        "array of 1e308": np.linspace(-1e308, 1e308, n),
        "complex array": np.ones(n) * 1j,
        "object array": np.array([None] * n),
        "bool array": np.arange(n) % 3 == 0,
        "text array": np.array(["1.0"] * n),
        "array of dates": np.arange(n).astype("datetime64[s]"),
        "masked array": np.ma.masked_where(np.arange(n) < 5, np.linspace(-1, 1, n)),
        "int8 array": (np.arange(n) % 7).astype(np.int8),
        "series": pandas.Series(np.linspace(-1, 1, n)),
        "list of 200": np.linspace(-1, 1, n).tolist(),
        "generator": (k for k in range(3)),
    }
