"""Tests on a record by whitening regression: one output on its own past, on the past of the inputs and on added terms.

A high-order ARX model whitens the output noise of any linear system, also of an integrating one (Ljung, System
Identification, 2nd ed. 1999, sections 10.3 and 16.5). What further columns explain of its errors is then tested
jointly. Such a test works in the space of the samples: columns that are nearly combinations of others (lags of an input
without power at high frequencies) have no coefficients worth the name, but the directions that they add are orthonormal
and the projection of the errors on them is as well determined as any.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import lfilter, lfiltic
from scipy.special import fdtrc

from sysid.data.record import IOData
from sysid.diagnosis.delay_range import DelayRange, delay_ranges
from sysid.diagnosis.finding import LEVEL

_NEW_DIRECTION = 1e-6  # part of a column that is left after the others, below which it adds nothing
_SHARED = 0.2  # leverage of a row that is evidence: more is risky (Huber, Robust Statistics, 1981, section 7.2)
_LEVERAGE = 0.5  # largest that counts: rows that determine their own value have no error to judge by
ORDERS = (2, 4, 8, 12, 16, 24, 32, 48)
LONGEST = 20_000  # samples; with more, the tests reject every model
_SLOWNESS = 1e-4  # p-value of errors that are slow: a drift leaves a little of itself in them
_LOOP = 0.01  # least share of the error's variance that is feedback
_SLOW = 20  # cosines beside a line
_BENT = 3  # lags of the input that a nonlinear effect is sought at
_LEAST = 30  # rows that a test needs beyond the number of coefficients


@dataclass(frozen=True)
class Directions:
    """Orthonormal directions U (M, k), the errors' projections s (k,) and p, how likely chance is; share of e'e."""

    U: np.ndarray
    s: np.ndarray
    p: float
    share: float


def orthonormal_columns(X: np.ndarray) -> np.ndarray:
    """Orthonormal columns (M, r) that span X (M, n)."""
    U, s, _ = np.linalg.svd(X / _column_norms(X), full_matrices=False)
    return np.asarray(U[:, s > 1e-10 * s[0]])


def joint_test(Q: np.ndarray, extra: np.ndarray, e: np.ndarray) -> Directions:
    """Test of the columns `extra` (M, k) beyond the orthonormal Q (M, r), for the errors e (M,) without them."""
    size = np.linalg.norm(extra, axis=0)
    extra = extra - extra.mean(axis=0)
    residue = extra / np.maximum(_column_norms(extra), _NEW_DIRECTION * size)  # a constant's rounding is no direction
    for _ in range(2):  # twice is enough (Kahan, in Parlett 1980)
        residue = residue - Q @ (Q.T @ residue)
    U, size, _ = np.linalg.svd(residue, full_matrices=False)
    U = U[:, size > _NEW_DIRECTION]
    return Directions(U, U.T @ e, p_value(Q, U, e), float(np.sum((U.T @ e) ** 2)) / (float(e @ e) or 1.0))


def shared_test(X: np.ndarray, y: np.ndarray, extra: np.ndarray) -> Directions:
    """Test of the columns `extra` (M, k) beyond X (M, n), for the errors that X leaves of y (M,).

    A row that determines a direction almost alone, as one before a jump of an input that seldom changes, is no evidence
    and is left out. No directions are left if there are none in all other rows.
    """
    while len(y) >= X.shape[1] + _LEAST:
        Q = orthonormal_columns(X)
        directions = joint_test(Q, extra, y - Q @ (Q.T @ y))
        shared = np.sum(directions.U**2, axis=1) <= _SHARED
        if shared.all():
            return directions
        X, y, extra = X[shared], y[shared], extra[shared]
    return Directions(np.zeros((len(y), 0)), np.zeros(0), 1.0, 0.0)


def p_value(Q: np.ndarray, U: np.ndarray, e: np.ndarray) -> float:
    """Probability that chance alone gives U'e (k,) as large, for errors e after the orthonormal Q (M, r)."""
    if not U.shape[1] or not np.any(e):
        return 1.0
    s, k = U.T @ e, U.shape[1]
    freedom = min(_freedom(U), len(e) - Q.shape[1] - k)
    if freedom < 1.0:
        return 1.0
    scale = freedom / (freedom + k - 1.0)
    return wald_p_value(s * np.sqrt(scale), robust_covariance(np.hstack([Q, U]), U, e - U @ s), freedom)


def _freedom(U: np.ndarray) -> float:
    """Degrees of freedom that the robust covariance leaves a test of the orthonormal directions U (M, k); none below 1.

    The covariance is taken for a Wishart matrix whose entries have the same total variance, nu = k (k + 1) / (2 sum
    h^2) with the leverages h (M,) of the rows, and the test for Hotelling's, nu - k + 1 (Pustejovsky and Tipton, J.
    Business and Economic Statistics 36, 2018). What an input of few changes adds stands in few rows, and each change
    counts as one; a single direction over all rows keeps one for each.
    """
    k, h = U.shape[1], np.sum(U**2, axis=1)
    return k * (k + 1.0) / (2.0 * float(h @ h)) - k + 1.0


def robust_covariance(Q: np.ndarray, U: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of U'e for errors `errors` after the orthonormal Q (M, r), which holds U.

    Robust to errors whose size changes along the record (White 1980, in the form HC3 of MacKinnon and White 1985).
    """
    leverage = np.minimum(np.sum(Q**2, axis=1), _LEVERAGE)
    half = U * (errors / (1.0 - leverage))[:, None]
    return np.asarray(half.T @ half)


def wald_p_value(s: np.ndarray, covariance: np.ndarray, freedom: float) -> float:
    """Probability that chance alone gives s (k,) of this covariance (k, k) as large (F)."""
    values, vectors = np.linalg.eigh(covariance)
    keep = values > 1e-8 * max(values[-1], 1e-300)
    m = int(keep.sum())
    if freedom < 1 or not m:
        return 1.0
    return float(fdtrc(m, freedom, float(np.sum((vectors[:, keep].T @ s) ** 2 / values[keep])) / m))


def _column_norms(X: np.ndarray) -> np.ndarray:
    norm = np.linalg.norm(X, axis=0)
    return np.asarray(np.where(norm > 0, norm, 1.0))


@dataclass(frozen=True)
class Regression:
    """Coefficients c (n,) by least squares, and errors e (M,)."""

    c: np.ndarray
    e: np.ndarray


@dataclass(frozen=True)
class Whitened:
    """Regression of output j of a record on the past: order p and the columns of p + 1 lags of each input.

    The lags of an input begin at the first delay that `ranges` does not exclude.
    """

    data: IOData
    output: int
    order: int
    regression: Regression
    X: np.ndarray  # columns: one, y(t-1)..y(t-p), then p + 1 lags of every input
    y: np.ndarray
    times: np.ndarray  # sample number of each row
    rows: tuple[np.ndarray, ...]  # rows of each experiment, numbered within it
    ranges: tuple[DelayRange, ...]
    starts: tuple[int, ...]  # first lag of each input

    def lags(self, i: int) -> slice:
        """Columns of input i, lags s..s + p from its first one."""
        start = 1 + self.order + i * (self.order + 1)
        return slice(start, start + self.order + 1)

    @cached_property
    def basis(self) -> np.ndarray:
        """Orthonormal columns (M, r) that span X."""
        return orthonormal_columns(self.X)

    def added(self, extra: np.ndarray) -> Directions:
        """The joint test of further columns (M, k)."""
        return shared_test(self.X, self.y, extra)

    def shifted(self, i: int, ahead: int) -> tuple[np.ndarray, np.ndarray]:
        """Input i `ahead` samples after each row's own (M,), and which rows have that sample."""
        values, has = [], []
        for e, rows in zip(self.data.head(LONGEST).experiments, self.rows, strict=True):
            k = rows + ahead
            ok = k < e.N
            values.append(np.where(ok, e.u[np.minimum(k, e.N - 1), i], 0.0))
            has.append(ok)
        return np.concatenate(values), np.concatenate(has)


def regress(X: np.ndarray, y: np.ndarray) -> Regression:
    """Least squares of y (M,) on X (M, n); directions that X does not determine are zero."""
    norm = np.linalg.norm(X, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    c = np.linalg.lstsq(X / norm, y, rcond=1e-10)[0]
    return Regression(c / norm, y - (X / norm) @ c)


def whiten(data: IOData, output: int = 0) -> Whitened | None:
    """The output on its past at the order that AIC prefers; None if the record is too short or constant."""
    if np.ptp(data.y[:, output]) == 0.0 or np.all(np.ptp(data.u, axis=0) == 0.0):
        return None
    lags_of = data.u.shape[1] + 1
    usable = [p for p in ORDERS if p * lags_of * 8 + _LEAST <= min(data.N, LONGEST)]
    if not usable:
        return None
    ranges = delay_ranges(data, output, LEVEL)
    starts = tuple(max(r.first(LEVEL) - 1, 0) for r in ranges)
    # All orders use the same rows; otherwise AIC would compare different data.
    first, best, best_aic = usable[-1], None, np.inf
    for p in usable:
        X, y, times, rows = _design(data, output, p, first, starts)
        if len(y) < X.shape[1] + _LEAST:
            break
        c = np.linalg.lstsq(X, y, rcond=1e-10)[0]
        loss = float(np.mean((y - X @ c) ** 2))
        floor = (1e-12 * float(np.ptp(y))) ** 2  # more than one order explains a noise-free record to rounding
        aic = len(y) * np.log(max(loss, floor)) + 2 * X.shape[1]
        if aic < best_aic - 1e-9:
            best, best_aic = p, aic
    if best is None:
        return None
    X, y, times, rows = _design(data, output, best, best, starts)
    return Whitened(data, output, best, regress(X, y), X, y, times, rows, ranges, starts)


def _design(
    data: IOData, output: int, p: int, first: int, starts: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[np.ndarray, ...]]:
    """Columns, output, sample numbers and rows of each experiment, from its sample `first` on, without gaps."""
    blocks, ys, times, rows, start = [], [], [], [], 0
    for e in data.head(LONGEST).experiments:
        t = np.arange(first + max(starts), e.N)
        observed = e.observed[:, output]
        for k in range(p + 1):
            t = t[observed[t - k]]
        past = [e.y[t - k, output] for k in range(1, p + 1)]
        inputs = [e.u[t - s - k, i] for i, s in enumerate(starts) for k in range(p + 1)]
        blocks.append(np.column_stack([np.ones(len(t)), *past, *inputs]))
        ys.append(e.y[t, output])
        times.append(start + t)
        rows.append(t)
        start += e.N
    return np.concatenate(blocks), np.concatenate(ys), np.concatenate(times), tuple(rows)


def free_run(white: Whitened) -> np.ndarray:
    """Output (M,) of the regression from the inputs alone, in the rows of `white`; not finite where it runs away.

    Only the first samples of each experiment, which give its initial state, are measured ones.
    """
    p, c = white.order, white.regression.c
    a, runs = np.concatenate([[1.0], -c[1 : p + 1]]), []
    for e, rows in zip(white.data.head(LONGEST).experiments, white.rows, strict=True):
        observed, y = e.observed[:, white.output], e.y[:, white.output]
        begin = p + max(white.starts)
        first = np.where(observed, y, y[observed].mean() if observed.any() else 0.0)[:begin]
        forcing = c[0] + sum(
            lfilter(np.r_[np.zeros(s), c[white.lags(i)]], [1.0], e.u[:, i]) for i, s in enumerate(white.starts)
        )
        with np.errstate(over="ignore", invalid="ignore"):
            response = lfilter([1.0], a, forcing[begin:], zi=lfiltic([1.0], a, first[::-1]))[0]
        runs.append(np.concatenate([first, response])[rows])
    return np.concatenate(runs)


def is_computed(white: Whitened, i: int) -> bool:
    """Whether input i of a sample follows from the output of that sample and the past, but for their last digits.

    Without that output it must not: of a plant with direct feedthrough and noise neither follows from the other.
    """
    own, has = white.shifted(i, 0)
    past = np.delete(white.X, white.lags(i).start, axis=1) if white.starts[i] == 0 else white.X
    past, own, y = past[has], own[has], white.y[has]
    with_output = np.column_stack([y, past])
    c, *_ = np.linalg.lstsq(with_output, own, rcond=None)
    left, without = own - with_output @ c, own - past @ np.linalg.lstsq(past, own, rcond=None)[0]
    digits = _last_digit(own) + abs(float(c[0])) * _last_digit(y)
    return bool(np.std(left) <= digits and np.std(without) > 10.0 * digits)


def _last_digit(x: np.ndarray) -> float:
    """The least difference of two values, within which a number was rounded when it was written."""
    return float(np.min(np.diff(np.unique(x)), initial=np.inf))


def feedback(white: Whitened, i: int = 0, ahead: int = 5) -> float | None:
    """p-value of the hypothesis that inputs 1..ahead samples later do not predict this output beyond its past.

    They do predict it if a controller responds to the output (Sims' test in the form of Geweke, Meese and Dent 1983). A
    response within the same sample appears in lag 0 of `delay`, not here. The input of the row's own sample is held
    fixed too, in case the delay is shorter than `white` takes it for. None if past inputs determine later ones, or do
    but for the rows before a few jumps. A share below a hundredth of the one-step error's variance counts as none: the
    error of a linear model of a nonlinear plant is a function of the input, and over many samples a trace of it follows
    later inputs too.
    """
    columns, has = zip(*(white.shifted(i, k) for k in range(ahead + 1)), strict=True)
    use = np.all(has, axis=0)
    X, later = np.column_stack([white.X, columns[0]]), np.column_stack(columns[1:])
    directions = shared_test(X[use], white.y[use], later[use])
    if not directions.U.shape[1]:
        return None
    return directions.p if directions.share >= _LOOP else 1.0


@dataclass(frozen=True)
class Nonlinearity:
    """p-value of the hypothesis that squares and cubes explain nothing, and the share of the one-step error's variance
    that they explain."""

    p_value: float
    share: float


def nonlinearity(white: Whitened, nk: int = 1) -> Nonlinearity | None:
    """Squares and cubes of the inputs at lags nk..nk+2 and of the output's last two samples, added to the linear model.

    A regression test of misspecification (Ramsey 1969; for systems Haber and Keviczky 1999, chapter 5). None if they
    add no information, as the squares of an input with two levels.
    """
    p = white.order
    lags = [
        white.lags(i).start + k
        for i, s in enumerate(white.starts)
        for k in range(min(max(nk - s, 0), p), min(max(nk - s, 0) + 2, p) + 1)
    ]
    signals = [white.X[:, k] for k in (*lags, 1, 2)]
    standardised = [(s - s.mean()) / (s.std() or 1.0) for s in signals]
    directions = white.added(np.column_stack([f for s in standardised for f in (s**2, s**3)]))
    return Nonlinearity(directions.p, directions.share) if directions.U.shape[1] else None


def bent_effect(white: Whitened, i: int = 0) -> float:
    """p-value of the hypothesis that input i has no effect by squares, cubes, size or products with the last output.

    A plant with friction, or one whose input enters with its size, may show no linear lag at all.
    """
    input_lags, last = white.lags(i), white.X[:, 1]
    columns = []
    for k in range(input_lags.start, min(input_lags.start + _BENT, input_lags.stop)):
        x = white.X[:, k] - white.X[:, k].mean()
        x = x / (x.std() or 1.0)
        columns += [x**2, x**3, np.abs(x), x * last]
    return white.added(np.column_stack(columns)).p


def drift(white: Whitened) -> float:
    """p-value of the hypothesis that the output has no linear drift beyond what its past and the inputs explain.

    Where the errors have more power in the slowest cosines than elsewhere, that power is the measure of chance, so that
    slow errors are no drift by themselves (Mueller and Watson, Econometrica 76, 2008).
    """
    t = (white.times - white.times.mean()) / max(np.ptp(white.times), 1)
    slow = np.cos(np.pi * np.outer(t + 0.5, np.arange(1, min(_SLOW, len(t) // 8) + 1)))
    Q, e = white.basis, white.regression.e
    columns = np.column_stack([t, slow])
    columns = columns - columns.mean(axis=0)
    columns = columns / np.linalg.norm(columns, axis=0)
    for _ in range(2):
        columns = columns - Q @ (Q.T @ columns)
    if np.linalg.norm(columns[:, 0]) < 1e-3:
        return 1.0
    U, R = np.linalg.qr(columns)
    s = (U.T @ e)[np.abs(np.diag(R)) > 1e-3]
    if len(s) < 5 or not np.any(s[1:]):
        return 1.0
    slowness = float(np.mean(s[1:] ** 2)) / (float(e @ e) / max(len(e) - Q.shape[1], 1))
    if fdtrc(len(s) - 1, len(e), slowness) < _SLOWNESS:
        return float(fdtrc(1, len(s) - 1, s[0] ** 2 / np.mean(s[1:] ** 2)))
    return white.added(t[:, None]).p


def drift_size(white: Whitened) -> float:
    """Change of the output over the record by a linear drift, in standard deviations of the output."""
    t = (white.times - white.times.mean()) / max(np.ptp(white.times), 1)
    slope = regress(np.column_stack([white.X, t]), white.y).c[-1]
    stays = 1.0 - float(np.sum(white.regression.c[1 : white.order + 1]))
    return float(abs(slope) / max(abs(stays), 1e-12) / (white.y.std() or 1.0))
