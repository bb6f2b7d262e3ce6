"""IOData: a uniformly sampled record that is ready to identify."""

from dataclasses import dataclass, field, replace

import numpy as np

from sysid.base.errors import InputError


@dataclass(frozen=True)
class IOData:
    """Input u (N, nu) and output y (N, ny), sampled every Ts [s], as float64 in rows of samples.

    One-dimensional arrays become one channel. `missing` (N, ny) marks outputs that were not measured: their values are
    ignored (nan is allowed) and stored as a straight line between their neighbours. `lengths` gives the samples of
    each merged experiment. `u_offset` (nu,) and `y_offset` (ny,) are the offsets that detrending removed, so that a
    figure can show the original scale. Raises InputError for lengths that differ, values that are not finite or not
    numbers, and a Ts that is not positive.
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
    missing: np.ndarray | None = None
    lengths: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        u, y = _channels(self.u, self.u_name), _channels(self.y, self.y_name, self.missing)
        if len(u) != len(y):
            raise InputError(f"u has {len(u)} samples and y has {len(y)}; give both the same length")
        if len(u) < 2:
            raise InputError(f"the record has {len(u)} sample(s); at least 2 are needed")
        if not (isinstance(self.Ts, (int, float, np.number)) and 0 < float(self.Ts) < np.inf):
            raise InputError(f"Ts is {self.Ts!r}; give the sampling time as a positive number of seconds")
        lengths = tuple(int(n) for n in self.lengths) or (len(u),)
        if sum(lengths) != len(u) or min(lengths) < 2:
            raise InputError(f"experiments of {lengths} samples do not make up {len(u)}; each needs at least 2")
        if self.missing is not None:
            mask = np.broadcast_to(np.asarray(self.missing, dtype=bool).reshape(len(y), -1), y.shape).copy()
            y = _bridged(y, mask, lengths, self.y_name)
            object.__setattr__(self, "missing", mask if mask.any() else None)
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "y", y)
        object.__setattr__(self, "Ts", float(self.Ts))
        object.__setattr__(self, "lengths", lengths)
        for name, n in (("u_offset", u.shape[1]), ("y_offset", y.shape[1])):
            offset = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), (n,)).copy()
            object.__setattr__(self, name, offset)

    @classmethod
    def merge(cls, *records: "IOData") -> "IOData":
        """One record of several experiments with the same channels and rate; each keeps its own initial state."""
        if not records:
            raise InputError("nothing to merge; give at least one record")
        first = records[0]
        for k, r in enumerate(records[1:], 2):
            if (r.u.shape[1], r.y.shape[1]) != (first.u.shape[1], first.y.shape[1]) or r.Ts != first.Ts:
                raise InputError(
                    f"record {k} has {r.u.shape[1]} inputs, {r.y.shape[1]} outputs and Ts {r.Ts} s, "
                    f"the first {first.u.shape[1]}, {first.y.shape[1]} and {first.Ts} s; "
                    "merge records of the same channels and Ts"
                )
            if not (np.allclose(r.u_offset, first.u_offset) and np.allclose(r.y_offset, first.y_offset)):
                raise InputError(f"record {k} has other offsets than the first; merge first, then detrend")
        masks = [np.zeros(r.y.shape, dtype=bool) if r.missing is None else r.missing for r in records]
        return replace(
            first,
            u=np.concatenate([r.u for r in records]),
            y=np.concatenate([r.y for r in records]),
            missing=np.concatenate(masks),
            lengths=tuple(n for r in records for n in r.lengths),
        )

    @property
    def experiments(self) -> "tuple[IOData, ...]":
        """The experiments one by one."""
        if len(self.lengths) == 1:
            return (self,)
        ends = np.cumsum(self.lengths)
        return tuple(self.select(int(e - n), int(e)) for n, e in zip(self.lengths, ends, strict=True))

    @property
    def observed(self) -> np.ndarray:
        """True (N, ny) where an output was measured."""
        return np.ones(self.y.shape, dtype=bool) if self.missing is None else ~self.missing

    @property
    def N(self) -> int:
        """Number of samples."""
        return len(self.u)

    @property
    def t(self) -> np.ndarray:
        """Time of each sample (N,) [s], from 0."""
        return np.arange(self.N) * self.Ts

    def select(self, start: int, stop: int) -> "IOData":
        """Samples start (included) to stop (excluded), as for a slice; they must lie within one experiment."""
        ends = np.cumsum(self.lengths)
        if np.searchsorted(ends, start, "right") != np.searchsorted(ends, min(stop, self.N) - 1, "right"):
            raise InputError(f"samples {start} to {stop} cross the border of two experiments; select within one")
        missing = None if self.missing is None else self.missing[start:stop]
        return replace(self, u=self.u[start:stop], y=self.y[start:stop], missing=missing, lengths=())

    def split(self, fraction: float = 0.5) -> "tuple[IOData, IOData]":
        """The first `fraction` of the record for estimation and the rest for validation."""
        if not 0 < fraction < 1:
            raise InputError(f"split is {fraction}; give a fraction between 0 and 1, for example 0.5")
        parts = []
        for e in self.experiments:
            cut = round(e.N * fraction)
            if min(cut, e.N - cut) < 2:
                raise InputError(
                    f"a split at {fraction} leaves {cut} and {e.N - cut} of {e.N} samples; each part needs 2"
                )
            parts.append((e.select(0, cut), e.select(cut, e.N)))
        return IOData.merge(*(p[0] for p in parts)), IOData.merge(*(p[1] for p in parts))


def siso(data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """u (N,) and y (N,) of a record with one input and one output; raises InputError for others."""
    if data.u.shape[1] != 1 or data.y.shape[1] != 1:
        raise InputError(
            f"the record has {data.u.shape[1]} inputs and {data.y.shape[1]} outputs; these structures take one of "
            "each: choose one column for u and one for y"
        )
    return data.u[:, 0], data.y[:, 0]


def _channels(values: np.ndarray, name: str, missing: np.ndarray | None = None) -> np.ndarray:
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
    finite = np.isfinite(array)
    if missing is not None:
        mask = np.asarray(missing, dtype=bool)
        if mask.shape not in (array.shape, (len(array),)):
            raise InputError(f"missing has shape {mask.shape} and {name} {array.shape}; give one mark for each sample")
        finite |= mask.reshape(len(array), -1)
    bad = np.argwhere(~finite)
    if len(bad):
        row = int(bad[0, 0])
        raise InputError(
            f"{name} is {array[tuple(bad[0])]} at sample {row} (from 0) and {len(bad)} value(s) are not finite; "
            "remove or fill these samples, or mark outputs as missing"
        )
    return array


def _bridged(y: np.ndarray, missing: np.ndarray, lengths: tuple[int, ...], name: str) -> np.ndarray:
    """y (N, ny) with straight lines over missing stretches, experiment by experiment."""
    end = 0
    for n in lengths:
        piece = slice(end, end + n)
        end += n
        for j in range(y.shape[1]):
            lost = missing[piece, j]
            if lost.all():
                raise InputError(f"every sample of {name} is marked as missing; leave that experiment out")
            if lost.any():
                k = np.arange(n)
                y[piece, j] = np.where(lost, np.interp(k, k[~lost], y[piece, j][~lost]), y[piece, j])
    return y
