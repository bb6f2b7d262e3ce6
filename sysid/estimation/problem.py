"""A chain and its records as a least-squares problem; a long record is run in pieces."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sysid.data.record import IOData
from sysid.estimation.objective import huber
from sysid.estimation.prior import Prior
from sysid.model.chain import Chain
from sysid.solver.covariance import Covariance, covariance, effective_count, rank
from sysid.solver.iterate import Options, iterate
from sysid.solver.linearisation import Linearisation, Rows
from sysid.solver.searches import LevenbergMarquardt

LONG = 40_000  # samples from which a record is taken in pieces
_LOST = 16.0 * float(np.finfo(float).eps)  # share of two numbers that is rounding of their sum
ROWS = 4096  # samples of a piece: its Jacobian stays in a processor's cache


@dataclass(frozen=True)
class ChainProblem:
    """min over p of the squared errors of all experiments, theta_k = theta0[k] + basis[:, moving] p_k.

    theta0 (K, P) is the point p = 0, one row for each experiment; the rows differ only in the initial states. moving
    (P,) marks the directions of the chain's basis in p. The directions of the first experiment come first (n,), then
    the initial states of the others. Missing samples are left out. `huber_threshold` is in the unit of y; `prior` adds
    errors of its own; `curvature_weight` weighs the maps' kinks, in the unit of y. The errors are those of the free run
    or, of a chain that predicts, one step ahead.
    """

    chain: Chain
    theta0: np.ndarray
    records: tuple[IOData, ...]
    moving: np.ndarray
    huber_threshold: float = np.inf
    prior: Prior | None = None
    curvature_weight: float = 0.0
    weights: np.ndarray = field(default_factory=lambda: np.ones(1))
    scratch: dict[int, np.ndarray] = field(default_factory=dict, compare=False, repr=False)  # J of each experiment

    @classmethod
    def least_squares(cls, chain: Chain, theta0: np.ndarray, u: np.ndarray, y: np.ndarray) -> "ChainProblem":
        """Plain least squares on one record u, y (N,) over all free parameters."""
        return cls(chain, theta0[None, :], (IOData(u, y),), chain.free)

    @classmethod
    def initial_state(cls, chain: Chain, theta0: np.ndarray, data: IOData) -> "ChainProblem":
        """Least squares over the initial state of one record only."""
        return cls(chain, theta0[None, :], (data,), chain.initial)

    @cached_property
    def experiment_states(self) -> np.ndarray:
        """Directions (P,) that every further experiment has separately."""
        return self.moving & self.chain.initial

    @property
    def start(self) -> np.ndarray:
        """p of theta0."""
        return np.zeros(int(self.moving.sum()) + (len(self.records) - 1) * int(self.experiment_states.sum()))

    @cached_property
    def anchor(self) -> np.ndarray:
        """theta0 in the directions of p: a search rounds the parameters, not what they have changed by."""
        first = np.linalg.solve(self.chain.basis, self.theta0[0])[self.moving]
        return np.concatenate([first, self.theta0[1:, self.experiment_states].ravel()])

    @cached_property
    def _reach(self) -> np.ndarray:
        """What the first n of p move: the free columns of the basis."""
        return self.chain.basis[:, self.moving]

    @cached_property
    def size(self) -> float:
        """y'y."""
        return float(sum(np.sum(r.y**2) for r in self.records))

    def thetas(self, p: np.ndarray) -> np.ndarray:
        """All parameters (K, P) at p."""
        way, n, m = np.zeros(self.theta0.shape), int(self.moving.sum()), int(self.experiment_states.sum())
        way += self._reach @ p[:n]
        for k in range(1, len(self.records)):
            way[k, self.experiment_states] = p[n + (k - 1) * m : n + k * m]
        thetas = self.theta0 + way
        # What is left of two that cancel is rounding, and the sign of a speed that is 0 would decide.
        return np.where(np.abs(thetas) <= _LOST * (np.abs(self.theta0) + np.abs(way)), 0.0, thetas)

    def repair(self, p: np.ndarray) -> np.ndarray:
        """p moved into the bounds and, where the blocks support it, to an admissible chain."""
        theta = self.thetas(p)[0]
        if not np.all(np.isfinite(theta)):
            return p
        admissible = self.chain.repair(theta)
        if np.array_equal(admissible, theta):
            return p
        p = p.copy()
        p[: int(self.moving.sum())] += np.linalg.solve(self.chain.basis, admissible - theta)[self.moving]
        return p

    def blocked(self, p: np.ndarray, gradient: np.ndarray) -> np.ndarray:
        """True where p is at a bound and the descent direction `gradient` points beyond it."""
        low, high = self.chain.at_limit(self.thetas(p)[0])
        n = int(self.moving.sum())
        at_bound = np.zeros(len(p), dtype=bool)
        at_bound[:n] = (low[self.moving] & (gradient[:n] < 0)) | (high[self.moving] & (gradient[:n] > 0))
        return at_bound

    def residual(self, p: np.ndarray) -> np.ndarray | None:
        """e (N,), or None where the chain is not admissible."""
        thetas = self.thetas(p)
        if not self.chain.admissible(thetas[0]):
            return None
        parts = [self._record_errors(theta, r) for theta, r in zip(thetas, self.records, strict=True)]
        if self.prior is not None:
            parts.append(self.prior.errors(thetas[0]))
        if self.curvature_weight:
            parts.append(-self.curvature_weight * self.chain.kinks(thetas[0], tangent=False)[0])
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def linearise(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """e (N,) and dyhat/dp (N, n), which the next call overwrites."""
        thetas = self.thetas(p)
        errors, rows = [], []
        for k, (theta, record) in enumerate(zip(thetas, self.records, strict=True)):
            yhat, J = self.chain.sensitivities(theta, record.u, self.scratch.get(k), record.y)
            self.scratch[k] = J
            e, J = self._rows(k, record.y, record.missing, yhat, J)
            errors.append(e)
            rows.append(J)
        for e, J in self._penalties(thetas[0]):
            errors.append(e)
            rows.append(J)
        return (errors[0], rows[0]) if len(rows) == 1 else (np.concatenate(errors), np.concatenate(rows))

    @cached_property
    def _in_pieces(self) -> bool:
        return sum(r.N for r in self.records) > LONG and in_pieces(self.chain)

    def compact(self, p: np.ndarray) -> Linearisation | None:
        """`linearise` in compact form, in pieces of the records; None where they are short or a block needs J whole."""
        if not self._in_pieces:
            return None
        thetas, rows = self.thetas(p), Rows(len(p))
        for k, (theta, record) in enumerate(zip(thetas, self.records, strict=True)):
            for part, yhat, J in pieces(self.chain, theta, record.u, tangent=True):
                missing = None if record.missing is None else record.missing[part]
                rows.add(*self._rows(k, record.y[part], missing, yhat, J))
        for e, J in self._penalties(thetas[0]):
            rows.add(e, J)
        return rows.linearisation

    @property
    def bare(self) -> "ChainProblem":
        """The same without penalties."""
        return replace(self, prior=None, curvature_weight=0.0)

    @property
    def plain(self) -> "ChainProblem":
        """The same with plain errors: no weights, no threshold, no penalties."""
        return replace(self.bare, huber_threshold=np.inf, weights=np.ones(1))

    def covariance(self, p: np.ndarray) -> Covariance:
        """Covariance of theta (of the first experiment) at p, of what stays at an active bound."""
        return self.uncertainty(p)[0]

    def count(self, p: np.ndarray) -> int:
        """d of the criteria: free directions after the gauge, with the initial states of every experiment.

        Directions that the data do not determine, such as knots that no sample reaches, fit no noise and do not count.
        """
        return self._count(p, self._bare_linearisation(p))

    def uncertainty(self, p: np.ndarray) -> tuple[Covariance, int]:
        """`covariance` and `count`, from one Jacobian; of the posterior where the record has chosen the prior."""
        lin = self._bare_linearisation(p)
        d = self._count(p, lin)
        if self.prior is not None and self.prior.chosen:
            lin, d = self._posterior(p, lin)
        free = ~self.blocked(p, lin.gradient)
        theta, n = self.thetas(p)[0], int(self.moving.sum())
        basis = np.zeros((len(theta), len(p)))
        basis[:, :n] = self.chain.basis[:, self.moving]
        redundant = np.linalg.solve(self.chain.basis, self.chain.gauge(theta))[self.moving]
        if len(p) > n:  # the gauge moves the other experiments' initial states too: leave it to the pseudo-inverse
            redundant = np.vstack([redundant, np.zeros((len(p) - n, redundant.shape[1]))])
        cov = covariance(lin.along(free), redundant[free], basis[:, free], d)
        return replace(cov, at_bound=np.any(basis[:, ~free] != 0.0, axis=1)), d

    def _posterior(self, p: np.ndarray, bare: Linearisation) -> tuple[Linearisation, int]:
        """The problem with its prior, which leaves the noise to the record's own errors, and d."""
        full = self.compact(p) or Linearisation.of(*self.linearise(p))
        return replace(full, cost=bare.cost, N=bare.N), round(effective_count(bare, full))

    def _bare_linearisation(self, p: np.ndarray) -> Linearisation:
        return self.bare.compact(p) or Linearisation.of(*self.bare.linearise(p))

    def _count(self, p: np.ndarray, lin: Linearisation) -> int:
        free = self.chain.count(self.thetas(p)[0]) + (len(self.records) - 1) * int(self.experiment_states.sum())
        return min(free, rank(lin)) if np.isfinite(lin.cost) and np.all(np.isfinite(lin.R)) else free

    def _record_errors(self, theta: np.ndarray, record: IOData) -> np.ndarray:
        """e of one record's observed samples."""
        if not self._in_pieces:
            return self._errors(record.y, record.missing, self.chain.outputs(theta, record.u, record.y))[0]
        e, n = np.empty(int(record.observed.sum())), 0
        for part, yhat, _ in pieces(self.chain, theta, record.u, tangent=False):
            missing = None if record.missing is None else record.missing[part]
            piece = self._errors(record.y[part], missing, yhat)[0]
            e[n : n + len(piece)] = piece
            n += len(piece)
        return e

    def _errors(
        self, y: np.ndarray, missing: np.ndarray | None, yhat: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
        """e of the observed samples by output, their mask (None if all) and the slope of the loss (None if 1)."""
        e = (self.weights * (y - yhat)).T.ravel()
        w = np.broadcast_to(self.weights, (y.shape[1],))
        slope = None if len(self.weights) == 1 and self.weights[0] == 1.0 else np.repeat(w, len(y))
        keep = None if missing is None else ~missing.T.ravel()
        if keep is not None:
            e, slope = e[keep], None if slope is None else slope[keep]
        if np.isfinite(self.huber_threshold):
            with np.errstate(over="ignore", invalid="ignore"):
                e, factor = huber(e, self.huber_threshold)
            slope = factor if slope is None else factor * slope
        return e, keep, slope

    def _rows(
        self, k: int, y: np.ndarray, missing: np.ndarray | None, yhat: np.ndarray, J: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """e and J in p for samples y, yhat (n, ny) of experiment k, whose J (ny n, P) may be overwritten."""
        e, keep, slope = self._errors(y, missing, yhat)
        J = self._in_basis(J, keep)
        if slope is not None:
            J = J * slope[:, None]
        if len(self.records) == 1:
            return e, J
        n, m = int(self.moving.sum()), int(self.experiment_states.sum())
        wide = np.zeros((len(J), n + (len(self.records) - 1) * m))
        if k == 0:
            wide[:, :n] = J
        else:
            wide[:, :n] = np.where(self.experiment_states[self.moving], 0.0, J)
            wide[:, n + (k - 1) * m : n + k * m] = J[:, self.experiment_states[self.moving]]
        return e, wide

    def _penalties(self, theta: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """e and J of the prior and of the kinks."""
        n, width = int(self.moving.sum()), len(self.start)
        if self.prior is not None:
            wide = np.zeros((len(self.prior.weight), width))
            wide[:, :n] = self.prior.jacobian(self.chain.basis[:, self.moving])
            yield self.prior.errors(theta), wide
        if self.curvature_weight:
            kink, d = self.chain.kinks(theta)
            wide = np.zeros((len(kink), width))
            wide[:, :n] = self.curvature_weight * (d @ self.chain.basis[:, self.moving])
            yield -self.curvature_weight * kink, wide

    def _in_basis(self, J: np.ndarray, keep: np.ndarray | None) -> np.ndarray:
        """J (ny N, P) by the chain's basis, its moving columns and observed rows only."""
        for b in self.chain.blocks:
            part = self.chain.index(b)
            if b.has_basis:
                J[:, part] = J[:, part] @ self.chain.basis[part, part]
        if not self.moving.all():
            J = J[:, self.moving]
        return J if keep is None else J[keep]


def search_best(
    problems: Iterable[ChainProblem], options: Options, theta: np.ndarray, cost: float = np.inf
) -> tuple[np.ndarray, float]:
    """theta (P,) and cost of the best of searches by Levenberg-Marquardt; those given where none is better."""
    for problem in problems:
        outcome = iterate(problem, problem.start, LevenbergMarquardt(), options)
        if outcome.cost < cost:
            theta, cost = problem.thetas(outcome.p)[0], outcome.cost
    return theta, cost


def in_pieces(chain: Chain) -> bool:
    """True if every block of the chain can carry its state from one piece to the next."""
    missing = (b.piecewise(np.zeros(b.n_parameters), 0, 0) is None for b in chain.blocks)
    return all(b.channels == (1, 1) for b in chain.blocks) and not any(missing)


def pieces(
    chain: Chain, theta: np.ndarray, u: np.ndarray, tangent: bool
) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Rows of the record u (N, 1), their outputs (n, 1) and Jacobian (n, P), which the next piece overwrites.

    Without `tangent` the Jacobian is (n, 0).
    """
    P = len(theta) if tangent else 0
    runs, q = [], 0
    for b in chain.blocks:
        run = b.piecewise(chain.part(theta, b), q, P)
        assert run is not None  # see `in_pieces`
        runs.append(run)
        q += b.n_parameters
    x0, room = np.ascontiguousarray(u[:, 0]), np.empty((min(ROWS, len(u)), P))
    for start in range(0, len(u), ROWS):
        rows = slice(start, min(start + ROWS, len(u)))
        x, J = x0[rows], room[: rows.stop - start]
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable trial overflows; its cost is then infinite
            for run in runs:
                x = run(x, J)
        yield rows, x[:, None], J
