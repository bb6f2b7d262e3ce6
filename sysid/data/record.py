"""IOData: a uniformly sampled record that is ready to identify."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from sysid.base.checks import checked, short_text
from sysid.base.errors import InputError
from sysid.base.handlers import Shown, handler
from sysid.base.rates import same_rate
from sysid.data import frames

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Names = str | Sequence[str]
LARGEST, SMALLEST = 1e151, 1e-151  # the squares of a record of a million samples still add up to a number


@checked(deferred=("u", "y", "Ts", "missing"))
@dataclass(frozen=True, repr=False)
class IOData(Shown):
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

    __iter__: ClassVar[None] = None  # without this, Python would take samples one by one through __getitem__

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
            y = _bridge_gaps(y, mask, lengths, self.y_name)
            object.__setattr__(self, "missing", mask if mask.any() else None)
        object.__setattr__(self, "u", u)
        object.__setattr__(self, "y", y)
        object.__setattr__(self, "Ts", float(self.Ts))
        object.__setattr__(self, "lengths", lengths)
        for name, n in (("u_offset", u.shape[1]), ("y_offset", y.shape[1])):
            try:
                offset = np.broadcast_to(np.asarray(getattr(self, name), dtype=float), (n,)).copy()
            except ValueError:
                raise InputError(
                    f"{name} is {short_text(getattr(self, name))}; give {n} number(s), one a channel"
                ) from None
            object.__setattr__(self, name, offset)

    @classmethod
    @checked
    def merge(cls, *records: "IOData") -> "IOData":
        """One record of several experiments with the same channels and rate; each keeps its own initial state.

        Sampling times up to 300 ppm apart are one rate; that of the first is kept (`sysid.base.rates`).
        """
        if not records:
            raise InputError("nothing to merge; give at least one record")
        first = records[0]
        for k, r in enumerate(records[1:], 2):
            if (r.u.shape[1], r.y.shape[1]) != (first.u.shape[1], first.y.shape[1]) or not same_rate(r.Ts, first.Ts):
                raise InputError(
                    f"record {k} has {r.u.shape[1]} inputs, {r.y.shape[1]} outputs and Ts {r.Ts} s, "
                    f"the first {first.u.shape[1]}, {first.y.shape[1]} and {first.Ts} s; "
                    "merge records of the same channels and Ts"
                )
            if r.u_name == first.y_name != first.u_name or r.y_name == first.u_name != first.y_name:
                raise InputError(
                    f"record {k} has {r.u_name!r} as input and {r.y_name!r} as output, the first {first.u_name!r} and "
                    f"{first.y_name!r}; give the channels of all records the same roles"
                )
            for unit, unit_of_first in ((r.u_unit, first.u_unit), (r.y_unit, first.y_unit)):
                if unit and unit_of_first and unit != unit_of_first:
                    raise InputError(
                        f"record {k} has a signal in {unit} that the first has in {unit_of_first}; convert one"
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
        ends = np.cumsum(self.lengths).tolist()
        return tuple(self._experiment(slice(end - n, end)) for n, end in zip(self.lengths, ends, strict=True))

    def _experiment(self, rows: slice) -> "IOData":
        """One experiment: its numbers were checked as part of this record, and each step of a search takes it."""
        made, mask = copy(self), None if self.missing is None else self.missing[rows]
        own: dict[str, Any] = {name: getattr(self, name).copy() for name in ("u_offset", "y_offset")}
        own |= {"u": self.u[rows].copy(), "y": self.y[rows].copy(), "lengths": (rows.stop - rows.start,)}
        own["missing"] = None if mask is None or not mask.any() else mask.copy()
        for name, value in own.items():
            object.__setattr__(made, name, value)
        return made

    @property
    def observed(self) -> np.ndarray:
        """True (N, ny) where an output was measured."""
        return np.ones(self.y.shape, dtype=bool) if self.missing is None else ~self.missing

    @property
    def experiment_numbers(self) -> np.ndarray:
        """The number (N,) from 0 of the experiment that a sample is of."""
        return np.repeat(np.arange(len(self.lengths)), self.lengths)

    @property
    def N(self) -> int:
        """Number of samples."""
        return len(self.u)

    @property
    def t(self) -> np.ndarray:
        """Time of each sample (N,) [s], from 0."""
        return np.arange(self.N) * self.Ts

    @checked
    def between(self, start: float | None = None, stop: float | None = None) -> "IOData":
        """The part with start <= t < stop [s], `t` from 0 at the first sample; None is the record's own end.

        Two parts with a border in common share no sample. The time of the part begins at 0 again. Raises InputError for
        times outside the record and for a part that crosses the border of two experiments.
        """
        end = self.N * self.Ts
        first, last = 0.0 if start is None else float(start), end if stop is None else float(stop)
        if not (0.0 <= first < last <= end * (1.0 + 1e-9)):
            raise InputError(
                f"between({start}, {stop}) of a record of {end:g} s; give seconds from 0 to {end:g}, the start first"
            )
        a, b = (int(np.ceil(t / self.Ts - 1e-6)) for t in (first, last))  # a stamp on a sample means that sample
        if b - a < 2:
            raise InputError(
                f"between({start}, {stop}) holds {b - a} sample(s) of {self.Ts:g} s; a record needs at least 2"
            )
        return self.select(a, b)

    def __getitem__(self, samples: slice) -> "IOData":
        """data[100:200]: samples 100 (included) to 200 (excluded), ends as in a list; for seconds see `between`."""
        ends = (samples.start, samples.stop) if isinstance(samples, slice) else (0.5,)
        if not all(end is None or isinstance(end, (int, np.integer)) for end in ends):
            raise InputError(
                "a record is cut by whole samples, as in data[100:200]; for seconds use data.between(2.0, 8.0)"
            )
        if samples.step not in (None, 1):
            raise InputError(
                f"data[::{samples.step}] would alias; use sysid.data.preprocess.resample(data, Ts=...).data"
            )
        a, b, _ = samples.indices(self.N)
        if b - a < 2:
            raise InputError(f"samples {a} to {b} of {self.N} are fewer than the 2 that a record needs")
        return self.select(a, b)

    @checked
    def select(self, start: int, stop: int) -> "IOData":
        """Samples start (included) to stop (excluded), as for a slice; they must lie within one experiment."""
        ends = np.cumsum(self.lengths)
        if np.searchsorted(ends, start, "right") != np.searchsorted(ends, min(stop, self.N) - 1, "right"):
            raise InputError(f"samples {start} to {stop} cross the border of two experiments; select within one")
        missing = None if self.missing is None or not len(self.y[start:stop]) else self.missing[start:stop]
        return replace(self, u=self.u[start:stop], y=self.y[start:stop], missing=missing, lengths=())

    @checked
    def head(self, samples: int) -> "IOData":
        """The first experiments, up to so many samples (at least 2) in all."""
        if samples >= self.N:
            return self
        remaining, parts = samples, []
        for e in self.experiments:
            if remaining >= 2:
                parts.append(e.select(0, min(e.N, remaining)))
                remaining -= e.N
        return IOData.merge(*parts)

    @checked
    def portion(self, samples: int) -> "IOData":
        """About so many samples (at least 2): of several experiments every second, third, ..., of one its head."""
        if samples >= self.N:
            return self
        every = round(self.N / samples)
        return IOData.merge(*self.experiments[::every]) if len(self.lengths) > every else self.head(samples)

    @checked
    def split(self, fraction: float = 0.5) -> "tuple[IOData, IOData]":
        """The first `fraction` of the record for estimation and the rest for validation."""
        if not 0 < fraction < 1:
            raise InputError(f"split is {fraction}; give a fraction between 0 and 1, for example 0.5")
        parts = []
        for e in self.experiments:
            border = round(e.N * fraction)
            if min(border, e.N - border) < 2:
                raise InputError(
                    f"a split at {fraction} leaves {border} and {e.N - border} of {e.N} samples; each part needs 2"
                )
            parts.append((e.select(0, border), e.select(border, e.N)))
        return IOData.merge(*(p[0] for p in parts)), IOData.merge(*(p[1] for p in parts))

    def plot(self) -> "Figure":
        """The record over time, a panel for each channel, with removed means restored; radians as degrees.

        The figure is pyplot's where matplotlib.pyplot is loaded, so that `plt.show()` shows it.
        """
        figure: Figure = handler(self).plot(self)
        return figure

    @classmethod
    @checked
    def from_pandas(cls, table: Any, input: Names, output: Names, Ts: float | None = None) -> "IOData":
        """The record in columns of a pandas DataFrame; nan in an output marks a missing sample.

        The sampling time is `Ts` [s], or that of the index: seconds, time stamps or time differences. A second, outer
        level of the index separates experiments. Units come from `table.attrs["units"]`, a dict by column, where there
        is one. Raises InputError for columns that are not there, for an index that is not uniform, and for one without
        times where no `Ts` is given.
        """
        return cls(**frames.of_pandas(table, input, output, Ts))

    def to_pandas(self) -> Any:
        """A pandas DataFrame: a column for each channel, the index in seconds; missing outputs are nan.

        Removed means are restored; `attrs["units"]` has the unit of each column. Several experiments are the outer
        level of the index. Raises InputError where pandas is not installed.
        """
        return frames.to_pandas(self)

    @classmethod
    @checked
    def from_xarray(cls, table: Any, input: Names, output: Names, Ts: float | None = None) -> "IOData":
        """The record in variables of an xarray Dataset of one dimension, as `from_pandas`; units from their attrs."""
        return cls(**frames.of_xarray(table, input, output, Ts))

    def to_xarray(self) -> Any:
        """An xarray Dataset over `time` [s], a variable for each channel with its unit; one experiment only.

        Removed means are restored. Raises InputError where xarray is not installed and for several experiments.
        """
        return frames.to_xarray(self)


def siso(data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """u (N,) and y (N,) of a record with one input and one output; raises InputError for others."""
    if data.u.shape[1] != 1 or data.y.shape[1] != 1:
        raise InputError(
            f"the record has {data.u.shape[1]} inputs and {data.y.shape[1]} outputs; these structures take one of "
            "each: choose one column for u and one for y"
        )
    return data.u[:, 0], data.y[:, 0]


def _channels(values: np.ndarray, name: str, missing: np.ndarray | None = None) -> np.ndarray:
    if isinstance(values, np.ma.MaskedArray) and np.any(np.ma.getmaskarray(values)):
        raise InputError(f"{name} has masked values; give the numbers without a mask, and missing= for lost outputs")
    try:
        array = np.asarray(values)
        if array.dtype.kind not in "biuf":
            raise TypeError
        array = np.array(array, dtype=float, order="C")
    except MemoryError:
        raise
    except Exception:  # an array of another library raises what it likes
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


def _bridge_gaps(y: np.ndarray, missing: np.ndarray, lengths: tuple[int, ...], name: str) -> np.ndarray:
    """y (N, ny) with straight lines over missing stretches, experiment by experiment."""
    end = 0
    for n in lengths:
        piece = slice(end, end + n)
        end += n
        for j in range(y.shape[1]):
            is_missing = missing[piece, j]
            if is_missing.all():
                raise InputError(f"every sample of {name} is marked as missing; leave that experiment out")
            if is_missing.any():
                y[piece, j][is_missing] = np.interp(
                    np.flatnonzero(is_missing), np.flatnonzero(~is_missing), y[piece, j][~is_missing]
                )
    return y


def check_magnitudes(data: IOData) -> None:
    """Raises InputError where a channel has values beyond `LARGEST` or varies by less than `SMALLEST`.

    A channel that does not vary at all passes: what that means depends on the caller.
    """
    for kind, signals, observed in (("input", data.u, None), ("output", data.y, data.observed)):
        for k, column in enumerate(signals.T):
            values = column if observed is None else column[observed[:, k]]
            if not len(values):
                continue
            largest, span = float(np.abs(values).max()), float(np.ptp(values))
            name = kind if signals.shape[1] == 1 else f"{kind} {k + 1}"
            if largest > LARGEST:
                raise InputError(
                    f"the {name} has values up to {largest:.3g}; a fit takes values up to {LARGEST:g}: rescale the "
                    "signal to another unit, or remove the samples that are no measurement"
                )
            if 0.0 < span < SMALLEST:
                raise InputError(
                    f"the {name} varies by {span:.3g}; a fit needs at least {SMALLEST:g}: rescale the signal to "
                    "another unit"
                )
