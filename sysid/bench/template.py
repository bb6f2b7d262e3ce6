"""Least-squares ARX, an equation-error fit: change me.

`qpal bench run --method THIS_FILE` runs it. It must not import sysid: it is run in an environment of its own.
"""

import numpy as np

REQUIREMENTS: list[str] = []  # what pip installs for it, such as ["scipy>=1.13"]; empty: the Python that runs qpal


def fit(data):
    """data.u, data.y: tuples of arrays (N,), one an experiment; data.Ts [s]; data.orders (nb, nf, nk) or None.

    Also data.missing (outputs that were not measured), data.seconds (end within them) and data.seed.
    """
    nb, na, nk = data.orders or (2, 2, 1)
    rows = [regressors(u, y, nb, na, nk) for u, y in zip(data.u, data.y, strict=True)]
    # Change this line: the estimate. A one-step-ahead least squares is biased by noise on the output.
    theta = np.linalg.lstsq(np.concatenate([X for X, _ in rows]), np.concatenate([z for _, z in rows]), rcond=None)[0]
    return Arx(theta, nb, na, nk)


def regressors(u, y, nb, na, nk):
    """Rows [-y(k-1) .. -y(k-na), u(k-nk) .. u(k-nk-nb+1), 1] and y(k)."""
    k = np.arange(max(na, nb + nk - 1), len(y))
    past = [-y[k - i] for i in range(1, na + 1)] + [u[k - nk - j] for j in range(nb)]
    return np.column_stack([*past, np.ones(len(k))]), y[k]


class Arx:
    def __init__(self, theta, nb, na, nk):
        self.theta, self.nb, self.na, self.nk = theta, nb, na, nk
        self.poles = np.roots([1.0, *theta[:na]])  # optional: the table then shows their error
        self.details = {"structure": f"ARX {na}, {nb}, {nk}"}  # optional: stop, loss, structure

    def simulate(self, u, y_init):
        """Free run (N,): only u and the first outputs y_init are known."""
        y = np.zeros(len(u))
        y[: len(y_init)] = y_init
        for k in range(len(y_init), len(u)):
            past = [-y[k - i] if k >= i else 0.0 for i in range(1, self.na + 1)]
            past += [u[max(k - self.nk - j, 0)] for j in range(self.nb)]
            y[k] = self.theta @ [*past, 1.0]
        return y
