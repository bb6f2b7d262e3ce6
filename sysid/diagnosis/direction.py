"""Whether an output rises or falls with its input, where a record shows that beyond doubt."""

import numpy as np
from scipy.signal import lfilter

from sysid.base.parallel import one_blas_thread
from sysid.data.record import IOData
from sysid.diagnosis.delays import delay_from_input
from sysid.diagnosis.whitening import whiten

WINDOWS = (5, 20, 80)  # samples; short ones for fast plants, long ones for slow plants and delays
_SURE, _AGREES = 8.0, 3.0  # standard deviations: of a slope over the whole record, and over one half of the inputs
_HORIZON = 500  # samples of a step response
_LEAST = 20  # windows


def direction(data: IOData, output: np.ndarray | None = None) -> int:
    """1 where the output rises with the input, -1 where it falls, 0 where the record leaves a doubt.

    For windows of several lengths the change of the output over a window is regressed on the mean of the input in it
    and on the output at its beginning; the slope has the sign of the static gain of a plant that settles, and of the
    speed of one that integrates. There is no doubt if at least one window shows it for certain, no window contradicts,
    and small and large inputs each agree. `output` (N,) takes the place of the measured first output, for example a
    model's.
    """
    y = data.y[:, 0] if output is None else np.asarray(output, dtype=float).ravel()
    statistics = [t for w in WINDOWS if w * _LEAST <= data.N and (t := _slope(data, y, w)) is not None]
    sure = [t for t in statistics if abs(t) > _SURE]
    if not sure or any(t * sure[0] < 0.0 for t in statistics if abs(t) > _AGREES):
        return 0
    return int(np.sign(sure[0]))


def confirmed(data: IOData, way: int) -> bool:
    """Whether the step responses of all likely linear models of the record end on the side `way` (1 or -1).

    Under an input of few frequencies a plant lags so far behind that its output falls while its input is large; windows
    take that for a negative gain, a model does not.
    """
    with one_blas_thread():
        white = whiten(data)
        models = () if white is None else delay_from_input(white).models
    with np.errstate(over="ignore", invalid="ignore"):
        ends = [lfilter(np.r_[np.zeros(m.nk), m.b], np.r_[1.0, m.f], np.ones(_HORIZON))[-1] for m in models]
    return bool(ends) and all(end * way > 0.0 for end in ends)


def _slope(data: IOData, y: np.ndarray, w: int) -> float | None:
    """The slope of windows of w samples in its standard deviations; 0 if one half of the inputs contradicts."""
    rows, change, begin = [], [], 0
    for e in data.experiments:
        output = y[begin : begin + e.N]
        begin += e.N
        ends = np.arange(0, e.N - w, w)
        if len(ends) == 0:
            continue
        sums = np.concatenate([[0.0], np.cumsum(e.u[:, 0])])
        rows.append(np.column_stack([np.ones(len(ends)), output[ends], (sums[ends + w] - sums[ends]) / w]))
        with np.errstate(invalid="ignore"):  # of a run that is not finite, which does not count
            change.append(output[ends + w] - output[ends])
    if not rows:
        return None
    X, d = np.concatenate(rows), np.concatenate(change)
    is_known = np.isfinite(X).all(axis=1) & np.isfinite(d)
    X, d = X[is_known], d[is_known]
    if len(d) < _LEAST:
        return None
    middle = float(np.median(X[:, 2]))
    halves = [_t(X[part], d[part]) for part in (X[:, 2] <= middle, X[:, 2] > middle)]
    statistic = _t(X, d)
    doubtful = any(t * statistic < 0.0 and abs(t) > _AGREES for t in halves)
    return 0.0 if doubtful else statistic


def _t(X: np.ndarray, d: np.ndarray) -> float:
    """The last coefficient of least squares in its standard deviations; 0 where the rows do not determine it."""
    if len(d) < _LEAST // 2 or np.ptp(X[:, -1]) == 0.0 or not np.any(d):
        return 0.0
    scale = np.abs(X).max(axis=0)
    A = X / np.where(scale > 0, scale, 1.0)
    inverse = np.linalg.pinv(A.T @ A)
    c = inverse @ (A.T @ d)
    e = d - A @ c
    spread = float(np.sqrt(inverse[-1, -1] * float(e @ e) / max(len(d) - 3, 1)))
    return float(c[-1]) / max(spread, 1e-12 * abs(float(c[-1])), 1e-300)
