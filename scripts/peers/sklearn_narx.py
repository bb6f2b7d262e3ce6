"""scikit-learn: NARX with a multilayer perceptron, chosen by its free run."""

import time
import warnings

import numpy as np

REQUIREMENTS = ["scikit-learn>=1.4"]
HIDDEN, DECAY, MORE_LAGS, SEEDS = ((16,), (32,), (16, 16)), (1e-4, 1e-2), (0, 1, 2, 4), 4


def fit(data):
    """Settings by the free run over the last quarter; then several seeds on all data, by the free run over it."""
    end = time.monotonic() + 0.85 * data.seconds
    nb, nf, nk = data.orders or (2, 2, 1)
    u, y = np.concatenate(data.u), np.concatenate(data.y)
    scale = (u.mean(), u.std() or 1.0, y.mean(), y.std() or 1.0)
    parts = [((a - scale[0]) / scale[1], (b - scale[2]) / scale[3], m)
             for a, b, m in zip(data.u, data.y, data.missing, strict=True)]  # fmt: skip
    early = [tuple(v[: 3 * len(v) // 4] for v in part) for part in parts]
    late = [tuple(v[3 * len(v) // 4 :] for v in part) for part in parts]
    warnings.simplefilter("ignore")
    began, tried = time.monotonic(), []
    Narx(early, (max(nf, 1), nb, nk), HIDDEN[-1], DECAY[0], data.seed, 10)
    most = int(np.clip(data.seconds / 8 / ((time.monotonic() - began) / 10), 20, 400))  # iterations of one fit
    for hidden, decay, more in ((h, d, m) for m in MORE_LAGS for d in DECAY for h in HIDDEN):
        if tried and time.monotonic() > end - 0.4 * data.seconds:
            break
        lags = (max(nf, 1) + more, nb + more, nk)
        tried.append((Narx(early, lags, hidden, decay, data.seed, most).loss(late), lags, hidden, decay))
    tried.sort(key=lambda each: each[0])
    best, best_loss, seeds, longest = None, np.inf, 0, 0.0
    for _, lags, hidden, decay in tried[:2]:
        for seed in range(SEEDS):
            began = time.monotonic()
            if best is not None and began + longest > end:
                break
            model = Narx(parts, lags, hidden, decay, 100 * data.seed + seed, most)
            loss, seeds, longest = model.loss(parts), seeds + 1, max(longest, time.monotonic() - began)
            if best is None or loss < best_loss:
                best, best_loss = model, loss
                best.details = {"structure": f"layers {hidden}, lags {lags[0]} of y and {lags[1]} of u, decay {decay}"}
    best.scale = scale
    best.details |= {"loss": best_loss * scale[3] ** 2, "stop": f"{len(tried)} settings, then {seeds} fits"}
    return best


class Narx:
    def __init__(self, parts, lags, hidden, decay, seed, most):
        from sklearn.neural_network import MLPRegressor

        self.na, self.nb, self.nk = lags
        self.first = max(self.na, self.nb + self.nk - 1)
        rows, targets = [], []
        for u, y, missing in parts:
            k = np.arange(self.first, len(y))
            past = [y[k - i] for i in range(1, self.na + 1)] + [u[k - self.nk - j] for j in range(self.nb)]
            good = ~np.any([missing[k - i] for i in range(self.na + 1)], axis=0)
            rows.append(np.column_stack(past)[good])
            targets.append(y[k][good])
        net = MLPRegressor(
            hidden_layer_sizes=hidden, activation="tanh", solver="lbfgs", alpha=decay, max_iter=most, random_state=seed
        )
        net.fit(np.concatenate(rows), np.concatenate(targets))
        self.weights, self.biases = [w.T.copy() for w in net.coefs_], net.intercepts_

    def loss(self, parts):
        """Mean squared error of the free run, from the first measured outputs."""
        errors = [(self.free_run(u, y[: self.first]) - y)[~missing] for u, y, missing in parts]
        with np.errstate(all="ignore"):
            return float(np.nan_to_num(np.mean(np.concatenate(errors) ** 2), nan=np.inf))

    def free_run(self, u, first):
        """The network's own forward pass, without the checks that cost most of `predict` on a single row."""
        y = np.concatenate([first, np.zeros(len(u) - len(first))])
        now = np.arange(self.nb)
        with np.errstate(all="ignore"):
            for k in range(len(first), len(u)):
                z = np.concatenate([y[k - self.na : k][::-1], u[k - self.nk - now]])
                for w, b in zip(self.weights[:-1], self.biases[:-1], strict=True):
                    z = np.tanh(w @ z + b)
                y[k] = (self.weights[-1] @ z + self.biases[-1])[0]
        return y

    def simulate(self, u, y_init):
        u0, su, y0, sy = self.scale
        added = max(self.first - len(y_init), 0)
        first = np.concatenate([np.full(added, y_init[0] if len(y_init) else y0), y_init])
        u = np.concatenate([np.full(added, u[0]), u])
        return (y0 + sy * self.free_run((u - u0) / su, (first - y0) / sy))[added:]
