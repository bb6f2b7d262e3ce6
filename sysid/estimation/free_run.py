"""The free run of a fitted chain on a record: from a likely initial state, and from another one where that diverges."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.data.record import IOData
from sysid.estimation.initial_prior import filters_only
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.joint_parts import is_joint
from sysid.model.chain import Chain

FAR = 1e6  # a run that covers this many times what the output covers, and what other runs cover, has diverged
_FOLLOWED = 4.0  # times the mean square error of the fit, above which a run does not follow it
_USE = "search further (fit.refine()), or use other orders or a lower degree"


@dataclass(frozen=True)
class FreeRun:
    """Outputs y (N, ny); `left` is the first sample at which the run from the likely state is not to be used, or None.

    Then y is the run from another state, or, where every one diverges, infinite from the sample `end` on.
    """

    y: np.ndarray
    left: int | None = None
    end: int | None = None


def rested(model: Chain, theta: np.ndarray) -> np.ndarray:
    """theta (P,) at rest: filters and speeds at zero, integrating states (motor, backlash) at their values in theta.

    In a fit these are the initial values of the first experiment.
    """
    moves = np.array([slot.initial and not slot.holds for slot in model.slots], dtype=bool)
    return np.where(moves, 0.0, theta)


def from_rest(model: Chain, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The run (N, ny) of u (N, nu) from rest; infinite once it is not a number."""
    return _ended(model.outputs(rested(model, theta), u)).y


def free_run(model: Chain, theta: np.ndarray, data: IOData, n: int, noise_variance: float) -> FreeRun:
    """The run on one experiment from the state that its first n outputs make likely, see `estimate_initial`.

    The window of outputs does not tell where a run ends that an unstable state space begins there. Where it diverges,
    the run is that from rest, from the initial state in theta (P,), or from the state of the least squares: the one
    that is nearest to the first outputs, of those that stay finite.
    """
    rest = rested(model, theta)
    if n < 2:
        return _ended(model.outputs(rest, data.u))
    first = data.select(0, n)
    run = model.outputs(estimate_initial(model, rest, first, data.u, noise_variance), data.u)
    size, limit = _covered(run), FAR * _covered(data.y)
    if np.isfinite(size) and (size <= limit or limit == 0.0):
        return FreeRun(run)
    others = [other for other in _others(model, theta, rest, first, data.u) if FAR * _covered(other) < size]
    if not others:
        return _ended(run) if not np.isfinite(size) else FreeRun(run)
    errors = [np.where(first.observed, first.y - other[:n], 0.0) for other in others]
    left = int(np.argmax(~np.all(np.abs(run - first.y[0]) <= limit, axis=1)))
    return FreeRun(others[int(np.argmin([np.sum(e**2) for e in errors]))], left)


def divergence(runs: Sequence[FreeRun]) -> str | None:
    """A sentence on the first of these experiments whose run diverges, if there is one."""
    bad = [(k, run) for k, run in enumerate(runs, 1) if run.left is not None]
    if not bad:
        return None
    k, run = next(((k, run) for k, run in bad if run.end is not None), bad[0])
    of = f" of experiment {k}" if len(runs) > 1 else ""
    if run.end is not None:
        return f"the free run diverges: it is not finite from sample {run.end}{of} on; {_USE}"
    return (
        f"from the state that the first outputs make likely the free run diverges at sample {run.left}{of}, so it "
        f"begins at another state; {_USE}"
    )


def departing(model: Chain, data: IOData, mse: float, run: Callable[[], list[FreeRun]], n: int) -> tuple[str, ...]:
    """A warning of a fit whose own record has a free run that diverges, or that is nowhere near its errors (`mse`).

    The errors of a fit are those from its fitted initial state; `run` gives the runs from the first n outputs of each
    experiment. Filters are left out, which settle from any state, and joints, which stops and friction hold.
    """
    if filters_only(model) or is_joint(model):
        return ()
    runs = run()
    if said := divergence(runs):
        return (said,)
    parts = [(e.y[n:], r.y[n:], e.observed[n:]) for e, r in zip(data.experiments, runs, strict=True)]
    y, yhat, seen = (np.concatenate(part) for part in zip(*parts, strict=True))
    apart = [float(np.mean((a[k] - b[k]) ** 2)) for a, b, k in zip(y.T, yhat.T, seen.T, strict=True)]
    own = [float(np.var(a[k])) for a, k in zip(y.T, seen.T, strict=True)]
    if not max(float(np.sum(own)), _FOLLOWED * mse) < float(np.sum(apart)):
        return ()
    return (
        f"from the state that the first {n} outputs make likely the free run is further from the output than its mean, "
        f"though the fit is not from its own initial state; {_USE}",
    )


def _others(model: Chain, theta: np.ndarray, rest: np.ndarray, first: IOData, u: np.ndarray) -> Iterator[np.ndarray]:
    for start in (theta, rest, estimate_initial(model, theta, first)):
        yield model.outputs(start, u)


def _covered(y: np.ndarray) -> float:
    """The largest range that an output of y (N, ny) covers; infinite where y is not finite."""
    if not np.all(np.isfinite(y)):
        return np.inf
    with np.errstate(over="ignore"):
        return float(np.max(np.ptp(y, axis=0), initial=0.0))


def _ended(y: np.ndarray) -> FreeRun:
    """A run that is infinite from the first sample on that is not finite."""
    bad = ~np.all(np.isfinite(y), axis=1)
    if not bad.any():
        return FreeRun(y)
    end = int(np.argmax(bad))
    return FreeRun(np.where(np.arange(len(y))[:, None] < end, y, np.inf), end, end)
