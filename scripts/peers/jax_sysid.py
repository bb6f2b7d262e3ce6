"""jax-sysid: nonlinear state space by L-BFGS, begun at a linear model and at random."""

import time

import numpy as np

REQUIREMENTS = ["jax-sysid>=1.1,<1.2"]  # below, its callback is replaced, which other versions may name otherwise
HIDDEN, ADAM, LBFGS, STARTS = 8, 300, 2000, 8


def fit(data):
    """A linear model; from it, and from random weights while there is time, nets beside its matrices."""
    import jax
    import jax.numpy as jnp
    import jax_sysid._model as library
    from jax_sysid.models import LinearModel, Model

    jax.config.update("jax_enable_x64", True)
    clock = Clock(time.monotonic() + 0.9 * data.seconds)
    library.lbfgs_callback = lambda *_: (clock.look, None)
    u, y = np.concatenate(data.u), np.concatenate(data.y)
    scale = (u.mean(), u.std() or 1.0, y.mean(), y.std() or 1.0)
    nk = data.orders[2] if data.orders else 1
    n = max(data.orders[1], data.orders[0]) if data.orders else 3
    U = [delayed((a - scale[0]) / scale[1], nk)[:, None] for a in data.u]
    # The library knows no gaps, but hands a row of Y to the loss as it is: its second column says what was measured.
    Y = [np.column_stack([(b - scale[2]) / scale[3], ~m]) for b, m in zip(data.y, data.missing, strict=True)]
    measured = sum(each[:, 1].sum() for each in Y)

    def output_loss(run, y):
        return jnp.sum(y[:, 1] * (run[:, 0] - y[:, 0]) ** 2) / y[:, 1].sum()

    linear = LinearModel(n, 1, 1, feedthrough=False)
    linear.loss(output_loss=output_loss, rho_x0=1e-3, rho_th=1e-6)
    linear.optimization(adam_epochs=0, lbfgs_epochs=LBFGS, iprint=-1)
    linear.init(seed=data.seed)
    clock.stop_after(0.2)
    linear.fit(list(Y), list(U))

    best, count = None, 0
    while best is None or (count < STARTS and clock.left() > 2.0 * clock.overhead):
        rng = np.random.default_rng([data.seed, count])
        model = Model(n, 1, 1, state_fcn=state, output_fcn=output)
        model.loss(output_loss=output_loss, rho_x0=1e-3, rho_th=1e-6)
        model.init(params=weights(n, rng, linear.params if count % 2 == 0 else None), x0=[np.zeros(n)] * len(U))
        adam = int(min(ADAM, 0.3 * clock.left() / clock.rate)) if count % 2 else 0
        model.optimization(adam_eta=0.01, adam_epochs=adam, lbfgs_epochs=LBFGS, iprint=-1)
        clock.stop_after(0.7 if count == 0 and clock.left() > 5.0 * clock.overhead else 1.0)
        model.fit(list(Y), list(U))
        starts = model.x0 if isinstance(model.x0, list) else [model.x0]
        runs = [np.asarray(model.predict(np.asarray(x), a)[0]) for x, a in zip(starts, U, strict=True)]
        error = np.concatenate([(r[:, 0] - b[:, 0]) * b[:, 1] for r, b in zip(runs, Y, strict=True)])
        loss, count = float(np.nan_to_num(error @ error, nan=np.inf)) / measured, count + 1
        if best is None or loss < best.loss:
            best = NeuralStateSpace([np.asarray(p) for p in model.params], scale, nk, loss)
    best.details = {"loss": best.loss * scale[3] ** 2, "structure": f"order {n}, {HIDDEN} tanh units a map"}
    best.details["stop"] = f"{count} starts of at most {LBFGS} iterations"
    return best


def delayed(u, nk):
    """The input shifted so that the model's own delay of one sample gives nk."""
    return u[np.clip(np.arange(len(u)) - (nk - 1), 0, len(u) - 1)]


def state(x, u, p):
    import jax.numpy as jnp

    A, B, _, W, V, b, H, *_ = p
    return A @ x + B @ u + H @ jnp.tanh(W @ x + V @ u + b)


def output(x, u, p):
    import jax.numpy as jnp

    _, _, C, *_, G, h, g = p
    return C @ x + g @ jnp.tanh(G @ x + h)


def weights(n, rng, linear):
    """Matrices of a linear model, or random stable ones, and nets whose output is small at first."""
    if linear is None:
        A, B, C = np.diag(rng.uniform(0.5, 0.98, n)), 0.3 * rng.standard_normal((n, 1)), rng.standard_normal((1, n))
    else:
        A, B, C = (np.array(each) for each in linear[:3])
    W, V, b = (rng.standard_normal(size) for size in ((HIDDEN, n), (HIDDEN, 1), HIDDEN))
    G, h = rng.standard_normal((HIDDEN, n)), rng.standard_normal(HIDDEN)
    return [A, B, C, 0.5 * W, V, b, 0.01 * rng.standard_normal((n, HIDDEN)), 0.5 * G, h,
            0.01 * rng.standard_normal((1, HIDDEN))]  # fmt: skip


class Clock:
    """Ends L-BFGS when its time is up, which the library cannot do; scipy takes StopIteration from a callback."""

    def __init__(self, end):
        self.end, self.rate, self.overhead = end, 0.01, 0.0
        self.stop_after(1.0)

    def left(self):
        return self.end - time.monotonic()

    def stop_after(self, share):
        """The next search may take this share of the time that is left."""
        self.began, self.seen = time.monotonic(), []
        self.until = self.began + share * max(self.left(), 0.0)

    def look(self, _):
        """The rate [s] of its iterations, and what passed before the first one: compilation."""
        self.seen.append(time.monotonic())
        self.overhead = self.seen[0] - self.began
        if len(self.seen) > 1:
            self.rate = max((self.seen[-1] - self.seen[0]) / (len(self.seen) - 1), 1e-5)
        if self.seen[-1] > self.until:
            raise StopIteration


class NeuralStateSpace:
    def __init__(self, params, scale, nk, loss):
        self.params, self.scale, self.nk, self.loss = params, scale, nk, loss
        self.n = len(params[0])

    def run(self, x, u):
        """The model in numpy, which needs no compilation for each length."""
        A, B, C, W, V, b, H, G, h, g = self.params
        B, C, V, g = B[:, 0], C[0], V[:, 0], g[0]
        out = np.empty(len(u))
        with np.errstate(all="ignore"):
            for k, now in enumerate(u):
                out[k] = C @ x + g @ np.tanh(G @ x + h)
                x = A @ x + B * now + H @ np.tanh(W @ x + V * now + b)
        return out

    def simulate(self, u, y_init):
        """The state at the start is fitted to the first outputs, from rest and from a steady input."""
        from scipy.optimize import least_squares

        u0, su, y0, sy = self.scale
        u, first = delayed((u - u0) / su, self.nk), (y_init - y0) / sy
        x0 = np.zeros(self.n)
        if len(first):
            error = lambda x: np.nan_to_num(self.run(x, u[: len(first)]) - first, nan=1e6, posinf=1e6, neginf=-1e6)  # noqa: E731
            starts = [least_squares(error, x) for x in (x0, np.random.default_rng(0).standard_normal(self.n))]
            x0 = min(starts, key=lambda found: found.cost).x
        return y0 + sy * self.run(x0, u)
