"""Trends: means, resting levels, straight lines or lines with kinks, removed and restored; other offsets."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import InputError, unknown
from sysid.base.quantities import display_quantity, unit_of_channel
from sysid.data.record import IOData

KINDS = ("mean", "linear", "steady")
CONSTANT = ("mean", "steady")
MOVED = 0.02  # of the range of an input, by which it has left its first value
SETTLED = 0.05  # of the range of an output, by which its two halves of a rest may differ
LEAST_REST = 10  # samples; fewer may be one step of a staircase


@dataclass(frozen=True)
class Trend:
    """The trend of a record: u (N, nu) and y (N, ny), sample by sample, for the record it was fitted to.

    `remove` and `restore` work on that record and on model outputs over it; a constant works on records of any length.
    """

    u: np.ndarray
    y: np.ndarray
    kind: str
    breaks: tuple[int, ...]
    sentence: str

    @classmethod
    def of(cls, data: IOData, kind: str = "linear", breaks: Sequence[int] = ()) -> "Trend":
        """Least squares over the measured samples: 'mean', or 'linear' with kinks at the samples `breaks` (from 0).

        'steady' is the level before the first movement of an input (`steady_level`).

        Lines are continuous at the kinks, unlike those of scipy.signal.detrend, whose jumps a model would have to
        explain. Every experiment has its own lines (breaks count from its start); a mean is taken over all
        experiments. Raises InputError for breaks outside the record or not in rising order, and for 'steady' if the
        record does not begin at rest.
        """
        if kind not in KINDS:
            raise unknown("trend", kind, KINDS)
        breaks = tuple(int(b) for b in breaks)
        if breaks and (kind in CONSTANT or sorted(set(breaks)) != list(breaks)):
            raise InputError(f"breaks are {breaks}; give rising sample numbers, and only with kind 'linear'")
        if breaks and (breaks[0] < 1 or breaks[-1] > min(data.lengths) - 2):
            raise InputError(f"breaks are {breaks}; give samples between 1 and {min(data.lengths) - 2}")
        if kind in CONSTANT:
            u, y = _means(data) if kind == "mean" else steady_level(data)
            fitted_u, fitted_y = np.broadcast_to(u, data.u.shape), np.broadcast_to(y, data.y.shape)
        else:
            parts = [_lines(e, breaks) for e in data.experiments]
            fitted_u, fitted_y = (np.concatenate([p[i] for p in parts]) for i in (0, 1))
        return cls(fitted_u, fitted_y, kind, breaks, _sentence(data, fitted_y, kind, breaks))

    def remove(self, data: IOData) -> IOData:
        """The record without the trend; a constant part is stored in `u_offset`, `y_offset` as in `detrend`."""
        u, y = self._values_on(data)
        offsets = {}
        if self.kind in CONSTANT:
            offsets = {"u_offset": data.u_offset + u[0], "y_offset": data.y_offset + y[0]}
        return replace(data, u=data.u - u, y=data.y - y, **offsets)

    def restore(self, data: IOData) -> IOData:
        """The record with the trend restored."""
        u, y = self._values_on(data)
        offsets = {}
        if self.kind in CONSTANT:
            offsets = {"u_offset": data.u_offset - u[0], "y_offset": data.y_offset - y[0]}
        return replace(data, u=data.u + u, y=data.y + y, **offsets)

    def restore_output(self, yhat: np.ndarray) -> np.ndarray:
        """A model's output (N,) or (N, ny) on the scale of the measurement."""
        y = self.y[:, 0] if np.ndim(yhat) == 1 else self.y
        if len(yhat) != len(y):
            raise InputError(f"the output has {len(yhat)} samples and the trend {len(y)}; give the same record")
        return np.asarray(yhat) + y

    def _values_on(self, data: IOData) -> tuple[np.ndarray, np.ndarray]:
        if self.kind in CONSTANT:
            return np.broadcast_to(self.u[0], data.u.shape), np.broadcast_to(self.y[0], data.y.shape)
        if (self.u.shape, self.y.shape) != (data.u.shape, data.y.shape):
            raise InputError(
                f"the record has {data.N} samples and the trend {len(self.u)}; give the record it was fitted to"
            )
        return self.u, self.y


def steady_level(data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """The levels u (nu,) and y (ny,) of the first experiment before an input first leaves its first value.

    It is the operating point at which an engineer has waited before a test. Raises InputError if the input moves
    within the first LEAST_REST samples, or if an output still moves before the input does.
    """
    e = data.experiments[0]
    moved = np.abs(e.u - e.u[0]) > MOVED * np.maximum(np.ptp(e.u, axis=0), 1e-300)
    n = int(np.argmax(moved.any(axis=1))) or e.N
    advice = "remove the mean instead, or choose a range that begins at rest"
    if n < LEAST_REST:
        raise InputError(
            f"the input moves at sample {n} (from 0), so the record does not begin at rest for {LEAST_REST} samples; "
            f"{advice}"
        )
    rest = e.select(0, n)
    halves = [_means(part)[1] for part in (rest.select(0, n // 2), rest.select(n // 2, n))]
    for j, (first_mean, second_mean) in enumerate(zip(*halves, strict=True)):
        span, noise = float(np.ptp(e.y[:, j])), float(np.std(np.diff(rest.y[:, j]))) / np.sqrt(2)
        if abs(second_mean - first_mean) > SETTLED * span + 3 * noise * np.sqrt(4 / n):
            raise InputError(
                f"before the input first moves, at {n * e.Ts:g} s, the output goes from {first_mean:.4g} to "
                f"{second_mean:.4g}, "
                f"{100 * abs(second_mean - first_mean) / span:.0f} % of its range: it is not at rest; {advice}"
            )
    return _means(rest)


def _means(data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """Means of u (nu,) and of the measured samples of y (ny,)."""
    observed = data.observed
    y = np.array([data.y[observed[:, j], j].mean() for j in range(data.y.shape[1])])
    return data.u.mean(axis=0), y


def _lines(e: IOData, breaks: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(e.N) / e.N  # of order one, so that the columns are well scaled
    hinges = [np.maximum(t - b / e.N, 0.0) for b in breaks]
    X = np.column_stack([np.ones(e.N), t, *hinges])
    observed = e.observed
    y = [X @ np.linalg.lstsq(X[observed[:, j]], e.y[observed[:, j], j], rcond=None)[0] for j in range(e.y.shape[1])]
    return X @ np.linalg.lstsq(X, e.u, rcond=None)[0], np.column_stack(y)


def _sentence(data: IOData, y: np.ndarray, kind: str, breaks: tuple[int, ...]) -> str:
    if kind in CONSTANT:
        return f"{'means' if kind == 'mean' else 'levels at rest'} removed: {_list(y[0], data.y_unit)} of the output"
    span = _list(np.ptp(y, axis=0), data.y_unit)
    kinks = f" with kinks at samples {', '.join(map(str, breaks))}" if breaks else ""
    return f"lines{kinks} removed from {len(data.lengths)} experiment(s); the line of the output spans {span}"


def _list(values: np.ndarray, unit: str) -> str:
    shown = [display_quantity("", unit_of_channel(unit, k)) for k in range(len(values))]
    return ", ".join(f"{q.factor * v:.4g} {q.unit}".rstrip() for q, v in zip(shown, values, strict=True))


def with_offsets(data: IOData, u_offset: np.ndarray | None, y_offset: np.ndarray | None) -> IOData:
    """The record with u (N, nu) and y (N, ny) counted from these offsets (nu,), (ny,); u + u_offset stays what it is.

    The record itself, bit for bit, if it is counted from them already, or if they are None (unknown).
    """
    if u_offset is None or y_offset is None:
        return data
    du, dy = data.u_offset - u_offset, data.y_offset - y_offset
    if not (du.any() or dy.any()):
        return data
    return replace(data, u=data.u + du, y=data.y + dy, u_offset=u_offset, y_offset=y_offset)


def restore_offsets(y: np.ndarray, levelled: IOData, data: IOData) -> np.ndarray:
    """Outputs y (N, ny) or (N,) of the record `levelled` at the level of `data`, from which `counted_from` made it."""
    if levelled is data:
        return y
    dy = levelled.y_offset - data.y_offset
    return y + (dy if y.ndim == 2 else dy[0])
