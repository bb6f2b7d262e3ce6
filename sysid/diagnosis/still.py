"""Signals that do not move: all along, or an output from some sample on, while its input goes on."""

import numpy as np

from sysid.base.quantities import display_quantity
from sysid.data.record import IOData
from sysid.diagnosis.finding import Advice, channel

LONG = 0.3  # of the record, for which an output stands still
MIDDLE, COVERED = (0.25, 0.75), (0.1, 0.9)  # quantiles of an input, between those that it has meanwhile


def constant(data: IOData, which: str, k: int) -> Advice | None:
    """The warning about input ("u") or output ("y") k if all its samples are one number; None if it moves."""
    values, unit = (data.u[:, k], data.u_unit) if which == "u" else (data.y[:, k], data.y_unit)
    if np.ptp(values) != 0.0:
        return None
    said = f"{channel(data, which, k)} is {_value(float(values[0]), unit)} in all {data.N} samples"
    why = (
        "it excites nothing, so the record shows no model"
        if which == "u"
        else "a sensor that does not read, or a plant that did not move"
    )
    todo = f"record again while the {'input' if which == 'u' else 'output'} moves, or choose another column"
    return Advice("data", f"{said}: {why}", float(data.N), todo, "warning")


def stuck(data: IOData, j: int) -> Advice | None:
    """The warning about output j if it has one and the same reading for a large part of the record while an input
    goes on to both sides, so that an end stop would be left; None if it does not."""
    y = data.y[:, j]
    edges = np.flatnonzero(np.concatenate([[True], np.diff(y) != 0.0, [True]]))
    runs = np.diff(edges)
    longest = int(np.argmax(runs))
    first, n = int(edges[longest]), int(runs[longest])
    at = np.arange(data.N)
    during = (at >= first) & (at < first + n)
    if n < LONG * data.N or during.all() or len(data.lengths) > 1 or not data.observed[during, j].all():
        return None
    low, high = np.quantile(data.u, MIDDLE, axis=0)
    now_low, now_high = np.quantile(data.u[during], COVERED, axis=0)
    if not np.any((now_low < low) & (high < now_high)):
        return None
    start, stop = first * data.Ts, (first + n) * data.Ts
    share = 100.0 * n / data.N
    said = (
        f"{channel(data, 'y', j)} stands at {_value(float(y[first]), data.y_unit)} from {start:.4g} s to {stop:.4g} s, "
        f"{share:.0f} % of the record, while the input moves: a sensor that died, or a plant that stuck"
    )
    end = first + n >= data.N
    kept = (0.0, start) if end or first >= data.N - first - n else (stop, data.N * data.Ts)
    span = f"{kept[0]:.4g}:{kept[1]:.4g}" if end or kept[0] == 0.0 else f"{kept[0]:.4g}:"
    return Advice(
        "data", said, share, "use the part in which it moves", "warning", command=("identify", "--range", span)
    )


def _value(value: float, unit: str) -> str:
    q = display_quantity("", unit)
    return f"{value * q.factor:.4g} {q.unit}".rstrip()
