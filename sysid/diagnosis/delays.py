"""The delay from an input to an output of a record, before any model, and its interval.

Joint tests of the lags say whether there is a response at all. Its delay comes from low-order models: for every delay
that `delay_range` leaves, B/F of a few orders is fitted, and delays whose best model is much less likely are out. Rough
models to begin with come from the regression's coefficients and their covariance (weighted null-space fitting,
Galrinho, Rojas and Hjalmarsson, IEEE Transactions on Automatic Control 64(7), 2019).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular, toeplitz

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.base.quantities import probability
from sysid.data.record import IOData
from sysid.diagnosis import delays
from sysid.diagnosis.low_order import Model, Profile, delay_by, pieces
from sysid.diagnosis.whitening import Whitened, joint_test, orthonormal_columns, robust_covariance, wald_p_value, whiten

ORDERS = ((1, 1), (1, 2), (2, 1), (2, 2), (2, 3), (3, 1), (3, 2), (3, 3), (4, 1), (4, 2), (4, 3))  # nf, nb
_ZEROS, _ROUNDS = 8, 2
_MOST_DELAYS = 40  # models of each order; of more likely delays every second, third, ... is tried
_HOPELESS = 60.0  # difference of rough criteria beyond which a delay is not tried
_NEW = 1e-8  # part of a lag that later lags leave, below which it adds nothing
_POLES = (0.9, 0.99)  # further poles to begin with
_REFINED = 3  # passes that follow the weights
_RIDGE = 1e-7  # of a column's norm: coefficients that the input does not determine are free, not zero


@dataclass(frozen=True)
class Delay:
    """Delay nk in samples and its interval low..high; nk is None if no lag has an effect.

    `p` is the probability that chance explains all lags together. With feedback, lag 0 may come from the controller and
    not from the plant. `models` are the likely models, best first. Delays 0..`longest` were tried.
    """

    nk: int | None
    low: int
    high: int
    p: float
    longest: int
    models: tuple[Model, ...] = ()

    @property
    def limit(self) -> str:
        """What to say of an interval that ends at the longest delay; empty of any other."""
        return "" if self.nk is None or self.high < self.longest else at_longest(self.longest)


def at_longest(longest: int) -> str:
    """The sentence on an interval that ends at the longest delay that is tried."""
    return (
        f"{longest} samples is the longest delay that a record of this length shows: the delay may be longer; record "
        "longer to know"
    )


def delay_from_input(white: Whitened, i: int = 0, level: float = 0.01) -> Delay:
    """Delay from input i. `level` is the chance that an input without effect is found to have one."""
    ps, start, longest = _nested_p_values(white, i), white.starts[i], white.ranges[i].longest
    positions = longest + 1 if start else 1  # of the lags: the record chose one
    p_of_lags = positions * min(float(ps[-1]), _p_value_of_averages(white, i))
    p = min(1.0, 3.0 * min(p_of_lags, white.ranges[i].p))
    if p >= level:
        return Delay(None, 0, longest, p, longest)
    models, gap = _models(white, i)
    likely_models = tuple(m for m in models if m.criterion <= models[0].criterion + _criterion_difference(level))
    lags = [m.nk for m in likely_models]
    if not _is_adequate(models[0], white):  # then only lags that have an effect for certain bound the delay
        lags.append(start + int(np.argmax(ps < level)) if np.any(ps < level) else longest)
    low, high = max(min(lags) - gap, 0), min(max(lags) + gap, longest)
    return Delay(models[0].nk, low, high, p, longest, likely_models)


def _is_adequate(m: Model, white: Whitened) -> bool:
    """Whether a low-order model leaves hardly more than the whole regression."""
    e = white.regression.e
    return m.variance <= 1.1 * float(e @ e) / max(len(e) - white.X.shape[1], 1)


def _p_value_of_averages(white: Whitened, i: int) -> float:
    """p-value of the hypothesis that input i has no effect, from a few averages over its lags.

    A test of all lags spreads over as many directions; a plant's response is mostly in few.
    """
    input_lags = white.lags(i)
    k = np.arange(input_lags.stop - input_lags.start)
    averages = white.X[:, input_lags] @ np.column_stack([np.exp(-k / tau) for tau in (1.0, 4.0, 16.0)])
    other_columns = np.delete(white.X, np.r_[input_lags], axis=1)
    Q = orthonormal_columns(other_columns)
    return joint_test(Q, averages, white.y - Q @ (Q.T @ white.y)).p


def _criterion_difference(level: float) -> float:
    """Difference of criteria at which one model is 1/level times as likely as the other."""
    return -2.0 * float(np.log(level))


def _nested_p_values(white: Whitened, i: int) -> np.ndarray:
    """p-values (p + 1,) of the hypotheses that lags 0..k of input i together have no effect, given the later ones."""
    columns = white.lags(i)
    lags = np.arange(
        columns.stop - 1, columns.start - 1, -1
    )  # the last lag first, so that the first ones are last in Q
    other_columns = np.setdiff1d(np.arange(white.X.shape[1]), lags)
    X = np.column_stack([white.X[:, other_columns], white.X[:, lags]])
    norm = np.linalg.norm(X, axis=0)
    Q, R = np.linalg.qr(X / np.where(norm > 0, norm, 1.0))
    new = np.abs(np.diag(R)) > _NEW
    s = Q.T @ white.y
    errors = white.y - Q[:, new] @ s[new]
    covariance = robust_covariance(Q[:, new], Q, errors)
    freedom, ps = len(errors) - int(new.sum()), np.ones(len(lags))
    for k in range(len(lags)):
        columns = np.flatnonzero(new[-1 - k :]) + X.shape[1] - 1 - k
        if len(columns):
            ps[k] = wald_p_value(s[columns], covariance[np.ix_(columns, columns)], freedom)
    return ps


def _models(white: Whitened, i: int) -> tuple[list[Model], int]:
    """Models of the likely delays and of several orders, best first; how many between two are left out."""
    rough = _rough_models(white, i)
    if white.data.u.shape[1] > 1:
        return rough, 0
    parts = pieces(white.data, i, white.output)
    if not parts:
        return rough, 0
    likely = white.ranges[i].within(_HOPELESS)
    step = -(-len(likely) // _MOST_DELAYS)
    profile = Profile(parts, int(likely[-1]))
    nk = int(np.argmin(white.ranges[i].criteria))
    denominators = {len(m.f): [m.f] for m in reversed(rough)}
    profile.whiten(_models_at_delay(profile, nk, denominators)[0])
    for _ in range(_ROUNDS):  # the colour of the errors follows the model, the orders the delay
        leaders = _models_at_delay(profile, nk, denominators)
        profile.whiten(leaders[0])
        orders = {(m.nk, len(m.f), len(m.b)): m.f for m in leaders}
        models_by_orders = {key: profile.model(*key, f) for key, f in orders.items()}
        for m in _leaders(models_by_orders):
            _sweep_delays(profile, m, likely[::step], models_by_orders)
        for m in _leaders(models_by_orders) if step > 1 else ():
            _sweep_delays(profile, m, likely[np.abs(likely - m.nk) < step], models_by_orders)
        for m in sorted(models_by_orders.values(), key=_criterion)[:_ZEROS]:
            for k in range(1, min(len(m.b), int(likely[-1]) - m.nk + 1)):  # leading zeros of b are delay
                key = (m.nk + k, len(m.f), len(m.b) - k)
                models_by_orders.setdefault(key, profile.model(*key, m.f))
        models = sorted(models_by_orders.values(), key=_criterion)
        if models[0].nk == nk:
            break
        nk, denominators = models[0].nk, {len(m.f): [m.f] for m in reversed(models)}
    return models, step - 1


def _leaders(models_by_orders: dict[tuple[int, int, int], Model]) -> list[Model]:
    """The best model of every number of poles: a wrong delay is best with too many."""
    ranked = sorted(models_by_orders.values(), key=_criterion)
    return list({len(m.f): m for m in reversed(ranked)}.values())


def _models_at_delay(profile: Profile, nk: int, denominators: dict[int, list[np.ndarray]]) -> list[Model]:
    """The best model of every pair of orders at one delay, best first; those of more poles begin at fewer, too."""
    fitted_models: list[Model] = []
    for nf in sorted({nf for nf, _ in ORDERS}):
        fewer = [m.f for m in sorted(fitted_models, key=_criterion) if len(m.f) == nf - 1][:1] or [np.zeros(nf - 1)]
        starts = denominators.get(nf, []) + [np.convolve(np.r_[1.0, fewer[0]], [1.0, -z])[1:] for z in _POLES]
        widest = max(nb for n, nb in ORDERS if n == nf)
        best = min((profile.model(nk, nf, widest, f) for f in starts), key=_criterion)
        fitted_models.append(best)
        fitted_models += [profile.model(nk, nf, nb, best.f) for n, nb in ORDERS if n == nf and nb < widest]
    return sorted(fitted_models, key=_criterion)


def _sweep_delays(
    profile: Profile, m: Model, delays: np.ndarray, models_by_orders: dict[tuple[int, int, int], Model]
) -> None:
    """Models of the same orders at all other delays, each from its neighbour."""
    for way in (delays[delays < m.nk][::-1], delays[delays > m.nk]):
        f = m.f
        for k in way:
            key = (int(k), len(m.f), len(m.b))
            if key not in models_by_orders:
                models_by_orders[key] = profile.model(*key, f)
            f = models_by_orders[key].f


def _criterion(m: Model) -> float:
    return m.criterion


def _rough_models(white: Whitened, i: int) -> list[Model]:
    """The same from the coefficients of the regression alone."""
    p, start = white.order, white.starts[i]
    norm = np.linalg.norm(white.X, axis=0)
    norm = np.where(norm > 0, norm, 1.0)
    n = len(norm)
    R = np.linalg.qr(np.vstack([white.X / norm, _RIDGE * np.eye(n)]), mode="r")
    e = white.regression.e
    freedom = max(len(e) - n, 1)
    half = solve_triangular(R, np.eye(n), trans="T") / norm * np.sqrt(float(e @ e) / freedom)
    c = solve_triangular(R, solve_triangular(R, white.X.T @ white.y / norm, trans="T")) / norm
    lags = white.lags(i)
    columns = np.r_[1 : p + 1, lags.start : lags.stop]
    half = np.asarray(np.linalg.qr(half[:, columns], mode="r"))
    a, g = np.concatenate([[1.0], -c[1 : p + 1]]), c[lags]
    candidates = []
    for nf, nb in ((1, 2), (2, 2), (3, 2), (4, 3)) if white.data.u.shape[1] == 1 else ORDERS:
        if nf + nb > p:
            continue
        for nk in range(p + 2 - nb):
            b, f, cost = _fit_null_space(a, g, half, nk, nb, nf)
            if np.isfinite(cost):
                candidates.append((nk, b, f, cost, nf + nb))
    if not candidates:
        return [Model(white.starts[i], np.zeros(1), np.zeros(0), 0.0, np.inf)]
    # Coefficients of a linear model of a nonlinear plant scatter more than their covariance says.
    excess = max(1.0, min(cost / max(p + 1 - d, 1) for *_, cost, d in candidates))
    price = float(np.log(len(e)))
    models = [Model(start + nk, b, f, cost / excess + price * d, 0.0) for nk, b, f, cost, d in candidates]
    return sorted(models, key=lambda m: m.criterion)


def _fit_null_space(
    a: np.ndarray, g: np.ndarray, half: np.ndarray, nk: int, nb: int, nf: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """b (nb,), f (nf,) of F G = q^-nk B A and the weighted square of what is left; half'half is the covariance."""
    p = len(a) - 1
    columns = [-delay_by(g, j) for j in range(1, nf + 1)] + [delay_by(a, nk + j) for j in range(nb)]
    Phi = np.column_stack(columns)
    b, f, cost = np.zeros(nb), np.zeros(nf), np.inf
    for _ in range(_REFINED):
        F, B = np.zeros(p + 1), np.zeros(p + 1)
        F[0], F[1 : nf + 1] = 1.0, f
        B[nk : nk + nb] = b
        low = np.zeros(p + 1)
        low[0] = F[0]
        TF, TB = toeplitz(F, low), toeplitz(B, np.r_[B[0], np.zeros(p)])
        root = np.linalg.qr(half[:, p:] @ TF.T + half[:, :p] @ TB[:, 1:].T, mode="r")
        try:
            W = solve_triangular(root, np.column_stack([g, Phi]), trans="T")
            x = np.linalg.lstsq(W[:, 1:], W[:, 0], rcond=None)[0]
        except (np.linalg.LinAlgError, ValueError):
            return b, f, np.inf
        errors = W[:, 0] - W[:, 1:] @ x
        f, b, cost = x[:nf], x[nf:], float(errors @ errors)
    return b, f, cost


@dataclass(frozen=True)
class DelayEstimate:
    """Delay nk and its interval low..high in samples of Ts [s]; nk is None where no lag of the input has an effect.

    `p` is the probability that chance explains all lags together, `level` the confidence of the interval. Delays
    0..`longest` were tried: an interval that ends there may be too short.
    """

    nk: int | None
    low: int
    high: int
    p: float
    Ts: float
    level: float
    longest: int

    def __str__(self) -> str:
        if self.nk is None:
            sentence = f"no response within {self.high} samples ({probability(self.p)} without any)"
            return f"{sentence}; check that the columns belong together"
        interval = (
            "" if self.low == self.high else f", {self.low} to {self.high} with {100 * self.level:g} % confidence"
        )
        limit = f"; {at_longest(self.longest)}" if self.high >= self.longest else ""
        return f"nk = {self.nk} ({self.nk * self.Ts:g} s){interval}{limit}"


@checked(late=True)
def delay(data: IOData, input: int = 0, output: int = 0, level: float = 0.99) -> DelayEstimate:
    """The delay nk of a model from input to output, both numbered from 0, with an interval of the confidence `level`.

    nk 1 is the least of a plant that is sampled before its input changes. Low-order models of every delay are compared,
    their errors whitened, so that slow noise neither hides nor feigns a delay. The first 3000 samples decide, and their
    fifth is the longest delay that is tried.
    Raises InputError for a channel that is not there, for a level that is no probability, and for a record that is too
    short or constant.
    """
    for role, k, n in (("input", input, data.u.shape[1]), ("output", output, data.y.shape[1])):
        if not 0 <= k < n:
            raise InputError(f"{role} is {k}; the record has {n}, numbered from 0")
    if not 0.0 < level < 1.0:
        raise InputError(f"level is {level}; give a probability between 0 and 1, for example 0.99")
    with one_blas_thread():
        white = whiten(data, output)
        if white is None:
            raise InputError(f"{data.N} samples are too few, or constant, to see a delay; record more")
        e = delays.delay_from_input(white, input, 1.0 - level)
    return DelayEstimate(e.nk, e.low, e.high, e.p, data.Ts, level, e.longest)
