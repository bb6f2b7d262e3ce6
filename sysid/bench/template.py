"""Least-squares ARX, an equation-error fit: change me.

This file must not import sysid: it runs in a process of its own. `qpal bench run --method THIS_FILE` puts it into the
table.
"""

import numpy as np

REQUIREMENTS: list[str] = []  # what pip installs for it, such as ["scipy>=1.13"]; empty: the Python that runs qpal


def fit(data):
    """data.u, data.y: tuples of arrays (N,), one an experiment; data.missing: outputs that were not measured.

    Also data.Ts [s], data.orders (nb, nf, nk) or None, data.seconds (end within them), data.seed, data.model.
    """
    nb, na, nk = data.orders or (2, 2, 1)
    X, y = rows(data.u, data.y, data.missing, nb, na, nk)
    theta = np.linalg.lstsq(X, y, rcond=None)[0]  # change this: noise on the output biases it
    return Arx(theta, nb, na, nk)


def rows(inputs, outputs, missing, nb, na, nk):
    """Regressors [-y(k-1) .. -y(k-na), u(k-nk) .. u(k-nk-nb+1), 1] and y(k) of all experiments, without gaps."""
    X, z = [], []
    for u, y, lost in zip(inputs, outputs, missing, strict=True):
        k = np.arange(max(na, nb + nk - 1), len(y))
        k = k[~np.any([lost[k - i] for i in range(na + 1)], axis=0)]
        past = [-y[k - i] for i in range(1, na + 1)] + [u[k - nk - j] for j in range(nb)]
        X.append(np.column_stack([*past, np.ones(len(k))]))
        z.append(y[k])
    return np.concatenate(X), np.concatenate(z)


class Arx:
    """What fit returns: simulate(u, y_init), and what else the table may show of it."""

    def __init__(self, theta, nb, na, nk):
        self.theta, self.nb, self.na, self.nk = theta, nb, na, nk
        self.poles = np.roots([1.0, *theta[:na]])  # optional
        self.details = {"structure": f"ARX {na}, {nb}, {nk}"}  # optional; also "stop", a sentence, and "loss"

    def simulate(self, u, y_init):
        """Free run (N,): only u (N,) and the first outputs y_init (n,) are known."""
        y = np.concatenate([y_init, np.zeros(len(u) - len(y_init))])
        for k in range(len(y_init), len(u)):
            past = [-y[k - i] if k >= i else 0.0 for i in range(1, self.na + 1)]
            past += [u[max(k - self.nk - j, 0)] for j in range(self.nb)]
            y[k] = self.theta @ [*past, 1.0]
        return y
