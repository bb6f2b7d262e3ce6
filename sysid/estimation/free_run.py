"""The free run of a fitted chain on a record, and how its residuals go on: what a chain predicts k samples ahead.

A chain has no noise model of its own: y = G u + v. With v(t) = a1 v(t-1) + ... + ap v(t-p) + white noise, the best
prediction from the outputs up to t-k is the free run plus the forecast of v (Ljung, System Identification, 2nd ed.
1999, section 3.2).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.data.record import IOData
from sysid.estimation.initial_state import estimate_initial, filters_only
from sysid.estimation.joint_parts import is_joint
from sysid.model.chain import Chain

FAR = 1e6  # a run that covers this many times what the output covers, and what other runs cover, has diverged
_FOLLOWED = 4.0  # times the mean square error of the fit, above which a run does not follow it
REMEDY = (
    "search further (fit.refine()), or use other orders, a lower degree or a structure whose filters are stable "
    "(output_error)"
)
PREDICT = "predict from measured outputs (fit.predict, qpal run with --horizon 1 on a log that has them)"
MOST = 16  # coefficients
_SHORTEST = 8  # samples for each coefficient
_ROUNDING = 1e-10  # of the output's size (rms): smaller residuals are no noise


def quiet() -> np.errstate:
    """Within it large numbers become infinite without NumPy's warnings: `beyond` says what became of a run."""
    return np.errstate(over="ignore", invalid="ignore", divide="ignore")


@dataclass(frozen=True)
class FreeRun:
    """Outputs y (N, ny); `left` is the first sample at which the run from the likely state is not to be used, or None.

    Then y is the run from another state, or, where every one diverges, infinite from the sample `end` on, or `far` from
    the record from `left` on.
    """

    y: np.ndarray
    left: int | None = None
    end: int | None = None
    far: bool = False


def resting_theta(model: Chain, theta: np.ndarray) -> np.ndarray:
    """theta (P,) at rest: filters and speeds at zero, integrating states (motor, backlash) at their values in theta.

    In a fit these are the initial values of the first experiment.
    """
    moves = np.array([slot.initial and not slot.holds for slot in model.slots], dtype=bool)
    return np.where(moves, 0.0, theta)


def at_rest(model: Chain, theta: np.ndarray) -> tuple[Chain, np.ndarray]:
    """The model and theta (P,) of a run from rest, see `Block.resting`."""
    return replace(model, blocks=tuple(b.resting() for b in model.blocks)), resting_theta(model, theta)


@quiet()
def run_from_rest(model: Chain, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The run (N, ny) of u (N, nu) from rest; infinite once it is not a number."""
    wider, rest = at_rest(model, theta)
    return _cut_at_divergence(wider.outputs(rest, u)).y


@quiet()
def free_run(model: Chain, theta: np.ndarray, data: IOData, n: int, noise_variance: float) -> FreeRun:
    """The run on one experiment from the state that its first n outputs make likely, see `estimate_initial`.

    The window of outputs does not tell where a run ends that an unstable state space begins there. Where it diverges,
    the run is that from rest, from the initial state in theta (P,), or from the state of the least squares: the one
    that is nearest to the first outputs, of those that stay finite.
    """
    if n < 2:
        wider, start = at_rest(model, theta)
        return _cut_at_divergence(wider.outputs(start, data.u))
    rest = resting_theta(model, theta)
    first = data.select(0, n)
    run = model.outputs(initial_theta(model, rest, first, data.u, noise_variance), data.u)
    size, limit = _output_range(run), FAR * _output_range(data.y)
    if np.isfinite(size) and (size <= limit or limit == 0.0):
        return FreeRun(run)
    fallbacks = [y for y in _fallback_runs(model, theta, rest, first, data.u) if FAR * _output_range(y) < size]
    departure = int(np.argmax(~np.all(np.abs(run - first.y[0]) <= limit, axis=1)))
    if not fallbacks:
        return _cut_at_divergence(run) if not np.isfinite(size) else FreeRun(run, departure, far=True)
    errors = [np.where(first.observed, first.y - y[:n], 0.0) for y in fallbacks]
    return FreeRun(fallbacks[int(np.argmin([np.sum(e**2) for e in errors]))], departure)


def initial_theta(model: Chain, theta: np.ndarray, *record: Any) -> np.ndarray:
    """`estimate_initial`, or theta (P,) as it is where the numbers are too large for any search."""
    try:
        return estimate_initial(model, theta, *record)
    except InputError:
        raise
    except (ValueError, np.linalg.LinAlgError):
        return theta


def beyond(y: np.ndarray, remedy: str, run: str = "the free run", far: float = np.inf, place: str = "") -> str | None:
    """The sentence on a run y (N,) or (N, ny) that is not finite, or is more than `far` from zero; None for another.

    Every run that a person gets is looked at here: it names the first such sample, and what to do.
    """
    rows = y.reshape(len(y), -1)
    bad = ~np.all(np.abs(rows) <= min(far, np.finfo(float).max), axis=1)
    if not bad.any():
        return None
    sample = int(np.argmax(bad))
    if np.isfinite(rows[sample]).all():
        return f"{run} diverges: from sample {sample}{place} on it is more than {far:.3g} from zero; {remedy}"
    return f"{run} diverges: it is not finite from sample {sample}{place} on; {remedy}"


def divergence(runs: Sequence[FreeRun], remedy: str = REMEDY) -> str | None:
    """A sentence on the first of these experiments whose run diverges, if there is one."""
    bad = [(k, run) for k, run in enumerate(runs, 1) if run.left is not None]
    if not bad:
        return None
    k, run = next(((k, run) for k, run in bad if run.end is not None), bad[0])
    place = f" of experiment {k}" if len(runs) > 1 else ""
    if run.end is not None:
        return beyond(run.y, remedy, place=place)
    if run.far:
        return (
            f"the free run diverges: from sample {run.left}{place} on it is more than {FAR:.0e} times the range of the "
            f"output away; {remedy}"
        )
    return (
        f"from the state that the first outputs make likely the free run diverges at sample {run.left}{place}, so it "
        f"begins at another state; {remedy}"
    )


def warn_of_divergence(
    model: Chain, data: IOData, mse: float, run: Callable[[], list[FreeRun]], n: int
) -> tuple[str, ...]:
    """A warning of a fit whose own record has a free run that diverges, or that is nowhere near its errors (`mse`).

    The errors of a fit are those from its fitted initial state; `run` gives the runs from the first n outputs of each
    experiment. Filters are left out, which settle from any state, and joints, which stops and friction hold.
    """
    if filters_only(model) or is_joint(model):
        return ()
    runs = run()
    if sentence := divergence(runs):
        return (sentence,)
    parts = [(e.y[n:], r.y[n:], e.observed[n:]) for e, r in zip(data.experiments, runs, strict=True)]
    y, yhat, observed = (np.concatenate(part) for part in zip(*parts, strict=True))
    errors = [float(np.mean((a[k] - b[k]) ** 2)) for a, b, k in zip(y.T, yhat.T, observed.T, strict=True)]
    variances = [float(np.var(a[k])) for a, k in zip(y.T, observed.T, strict=True)]
    if not max(float(np.sum(variances)), _FOLLOWED * mse) < float(np.sum(errors)):
        return ()
    return (
        f"from the state that the first {n} outputs make likely the free run is further from the output than its mean, "
        f"though the fit is not from its own initial state; {REMEDY}",
    )


def _fallback_runs(
    model: Chain, theta: np.ndarray, rest: np.ndarray, first: IOData, u: np.ndarray
) -> Iterator[np.ndarray]:
    for start in (theta, rest, initial_theta(model, theta, first)):
        yield model.outputs(start, u)


def _output_range(y: np.ndarray) -> float:
    """The largest range that an output of y (N, ny) covers; infinite where y is not finite."""
    if not np.all(np.isfinite(y)):
        return np.inf
    with np.errstate(over="ignore"):
        return float(np.max(np.ptp(y, axis=0), initial=0.0))


def _cut_at_divergence(y: np.ndarray) -> FreeRun:
    """A run that is infinite from the first sample on that is not finite."""
    bad = ~np.all(np.isfinite(y), axis=1)
    if not bad.any():
        return FreeRun(y)
    end = int(np.argmax(bad))
    return FreeRun(np.where(np.arange(len(y))[:, None] < end, y, np.inf), end, end)


def autoregression(v: np.ndarray, lengths: Sequence[int], size: float = 0.0) -> tuple[float, ...]:
    """Coefficients a1..ap of residuals v (N,) of several experiments, stable by construction (Yule-Walker).

    The order up to 16 is that of the least AIC; none for white noise, and for residuals that are rounding of an output
    of this `size` (rms).
    """
    ends = np.cumsum(lengths)
    pieces = [v[end - n : end] for n, end in zip(lengths, ends, strict=True)]
    max_order = min(MOST, len(v) // _SHORTEST, min(lengths) - 1)
    if not np.all(np.isfinite(v)) or not np.any(v):
        return ()
    # A power of two: squares stay finite, and no digit moves.
    unit = np.ldexp(1.0, int(np.frexp(np.abs(v).max())[1]) - 1)
    v, size, pieces = v / unit, size / unit, [piece / unit for piece in pieces]
    if np.sqrt(np.mean(v**2)) <= _ROUNDING * size:
        return ()
    r = np.array([sum(float(p[k:] @ p[: len(p) - k]) for p in pieces) for k in range(max_order + 1)]) / len(v)
    best, least = np.empty(0), len(v) * np.log(r[0])
    for p in range(1, max_order + 1):
        a = solve_toeplitz(r[:p], r[1 : p + 1])
        variance = r[0] - float(a @ r[1 : p + 1])
        if variance <= 1e-12 * r[0]:
            break
        aic = len(v) * np.log(variance) + 2 * p
        if aic < least:
            best, least = a, aic
    return tuple(float(x) for x in best)


@quiet()
def forecast(v: np.ndarray, a: Sequence[float], horizon: int, observed: np.ndarray | None = None) -> np.ndarray:
    """v(t | t-horizon) (N,): each residual from those up to `horizon` samples before it, none before the record.

    A residual that was not `observed` (N,) is replaced by its own forecast.
    """
    p = len(a)
    if not p:
        return np.zeros_like(v)
    if observed is not None and not observed.all():
        v, c = v.copy(), np.array(a)
        for t in np.flatnonzero(~observed):
            past = v[max(t - p, 0) : t][::-1]
            v[t] = float(c[: len(past)] @ past)
    step = np.eye(p, k=-1)
    step[0] = np.array(a)
    weights = np.linalg.matrix_power(step, horizon)[0]
    delayed = np.concatenate([np.zeros(min(horizon, len(v))), v[: max(len(v) - horizon, 0)]])
    return np.asarray(lfilter(weights, [1.0], delayed))
