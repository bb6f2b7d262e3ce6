"""scipy.least_squares: Hammerstein-Wiener by finite differences, as anyone would write it."""

import time

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter, lfilter_zi

REQUIREMENTS: list[str] = []  # scipy is where qpal is
PACKAGE = "scipy"
KNOTS, STARTS = 8, 8


def fit(data):
    """Piecewise linear maps on fixed grids, B/F between them; several starts, the best wins."""
    rng, end, best = np.random.default_rng(data.seed), time.monotonic() + 0.9 * data.seconds, (np.inf, None)
    u, y = np.concatenate(data.u), np.concatenate(data.y)
    model, seen = HammersteinWiener(data.orders or (2, 2, 1), u, y), [~m for m in data.missing]

    def residual(theta):
        if time.monotonic() > end:
            raise TimeoutError
        runs = [model.run(theta, u, x0) for u, x0 in zip(data.u, model.states(theta, len(data.u)), strict=True)]
        error = np.concatenate([(r - y)[m] for r, y, m in zip(runs, data.y, seen, strict=True)]) / model.y_std
        if error @ error < best_now[0]:
            best_now[:] = error @ error, theta.copy()
        return error

    stop = f"{STARTS} starts"
    for k in range(STARTS):
        best_now: list = [np.inf, None]
        try:
            least_squares(residual, model.start(data, rng if k else None), method="trf", x_scale=1.0, max_nfev=200)
        except (TimeoutError, ValueError, np.linalg.LinAlgError) as error:
            stop = f"time was up in start {k + 1}" if isinstance(error, TimeoutError) else stop
        best = min(best, tuple(best_now), key=lambda pair: pair[0])
        if time.monotonic() > end:
            break
    return model.with_parameters(best[1], {"stop": stop, "loss": best[0] * model.y_std**2 / sum(m.sum() for m in seen)})


class HammersteinWiener:
    def __init__(self, orders, u, y):
        self.nb, self.nf, self.nk = orders
        self.y_std, self.n = float(y.std()) or 1.0, max(self.nb + self.nk - 1, self.nf)
        self.grid_u, self.grid_w = np.linspace(u.min(), u.max(), KNOTS), np.linspace(-2.5, 2.5, KNOTS)
        self.y_mean, self.size = float(y.mean()), 2 * KNOTS + self.nb + self.nf

    def start(self, data, rng):
        """Straight maps about a stable first-order lag, or about random poles."""
        poles = np.full(self.nf, 0.8) if rng is None else rng.uniform(0.2, 0.99, self.nf)
        f = np.atleast_1d(np.poly(poles))[1:]
        span = self.grid_u[-1] - self.grid_u[0] or 1.0
        x = 4.0 * (self.grid_u - self.grid_u[0]) / span - 2.0
        side = 1.0 if rng is None else rng.choice([-1.0, 1.0])
        b = np.full(self.nb, (1 + f.sum()) / self.nb)
        return np.concatenate([x, side * self.grid_w, b, f, np.zeros(self.n * len(data.u))])

    def states(self, theta, count):
        return theta[self.size :].reshape(count, self.n)

    def run(self, theta, u, x0):
        """Output (N,) from the state that suits the first input, and x0 (n,) beside it."""
        x = bent(u, self.grid_u, theta[:KNOTS])
        b = np.concatenate([np.zeros(self.nk), theta[2 * KNOTS : 2 * KNOTS + self.nb]])
        f = np.concatenate([[1.0], theta[2 * KNOTS + self.nb : self.size]])
        f *= min(1.0, 0.9999 / max(np.abs(np.roots(f)).max(initial=0.0), 1e-9)) ** np.arange(len(f))  # stable
        b, f = (np.pad(v, (0, self.n + 1 - len(v))) for v in (b, f))
        w = lfilter(b, f, x, zi=lfilter_zi(b, f) * x[0] + x0)[0] if self.n else b[0] * x
        return self.y_mean + self.y_std * bent(w, self.grid_w, theta[KNOTS : 2 * KNOTS])

    def with_parameters(self, theta, details):
        self.theta, self.details = theta[: self.size], details
        self.poles = np.roots(np.concatenate([[1.0], self.theta[2 * KNOTS + self.nb :]]))
        return self

    def simulate(self, u, y_init):
        """The state is fitted to the first outputs."""
        n, x0 = len(y_init), np.zeros(self.n)
        if n and self.n:
            x0 = least_squares(lambda x: self.run(self.theta, u[:n], x) - y_init, x0).x
        return self.run(self.theta, u, x0)


def bent(x, grid, values):
    """Piecewise linear, with its end slopes beyond the grid."""
    step = grid[1] - grid[0] or 1.0
    k = np.clip(((x - grid[0]) / step).astype(int), 0, len(grid) - 2)
    return values[k] + (values[k + 1] - values[k]) * (x - grid[k]) / step
