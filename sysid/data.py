"""IOData: a uniformly sampled record that is ready to identify."""

from dataclasses import dataclass, field, replace

import numpy as np

from sysid.errors import InputError


@dataclass(frozen=True)
class IOData:
    """Input u (N, nu) and output y (N, ny), sampled every Ts [s], as float64 in rows of samples.

    One-dimensional arrays become one channel. `u_offset` (nu,) and `y_offset` (ny,) are what detrending took away, so
    that a figure can show the engineer's own scale again. Raises InputError for lengths that differ, values that are
    not finite or not numbers, and a Ts that is not positive.
    """

    u: np.ndarray
    y: np.ndarray
    Ts: float = 1.0
    u_name: str = "u"
    y_name: str = "y"
    u_unit: str = ""
    y_unit: str = ""
    u_offset: np.ndarray = field(default_factory=lambda: np.zeros(1))
    y_offset: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def __post_init__(self) -> None:
        u, y = _channels(self.u, self.u_name), _channels(self.y, self.y_name)
        if len(u) != len(y):
            raise InputError(f"u has {len(u)} samples and y has {len(y)}; give both the same length")
        if len(u) < 2:
            raise InputError(f"the record has {len(u)} sample(s); at least 2 are needed")
        if not (isinstance(self.Ts, (int, float, np.number)) and 0 < float(self.Ts) < np.inf):
            raise InputError(f"Ts is {self.Ts!r}; give the sampling time as a positive number of seconds")
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "y", y)
        object.__setattr__(self, "Ts", float(self.Ts))
        for name, n in (("u_offset", u.shape[1]), ("y_offset", y.shape[1])):
            offset = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), (n,)).copy()
            object.__setattr__(self, name, offset)

    @property
    def N(self) -> int:
        """Number of samples."""
        return len(self.u)

    @property
    def t(self) -> np.ndarray:
        """Time of each sample (N,) [s], from 0."""
        return np.arange(self.N) * self.Ts

    def select(self, start: int, stop: int) -> "IOData":
        """Samples start (included) to stop (excluded), as for a slice."""
        return replace(self, u=self.u[start:stop], y=self.y[start:stop])

    def split(self, fraction: float = 0.5) -> "tuple[IOData, IOData]":
        """The first `fraction` of the record for estimation and the rest for validation."""
        if not 0 < fraction < 1:
            raise InputError(f"split is {fraction}; give a fraction between 0 and 1, for example 0.5")
        cut = round(self.N * fraction)
        if min(cut, self.N - cut) < 2:
            raise InputError(
                f"a split at {fraction} leaves {cut} and {self.N - cut} of {self.N} samples; each part needs 2"
            )
        return self.select(0, cut), self.select(cut, self.N)


def siso(data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """u (N,) and y (N,) of a record with one input and one output; raises InputError for others."""
    if data.u.shape[1] != 1 or data.y.shape[1] != 1:
        raise InputError(
            f"the record has {data.u.shape[1]} inputs and {data.y.shape[1]} outputs; these structures take one of "
            "each: choose one column for u and one for y"
        )
    return data.u[:, 0], data.y[:, 0]


def _channels(values: np.ndarray, name: str) -> np.ndarray:
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biuf":
            raise TypeError
        array = np.array(array, dtype=float, order="C")
    except (TypeError, ValueError):
        raise InputError(f"{name} holds values that are not real numbers; give an array of floats") from None
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.shape[1] == 0:
        raise InputError(f"{name} has shape {array.shape}; give (N,) or (N, channels)")
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        row = int(bad[0, 0])
        raise InputError(
            f"{name} is {array[tuple(bad[0])]} at sample {row} (from 0) and {len(bad)} value(s) are not finite; "
            "remove or fill these samples first"
        )
    return array
