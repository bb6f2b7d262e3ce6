"""sysidentpy: polynomial NARX, terms chosen by FROLS, the model chosen by its free run."""

import time
import warnings

import numpy as np

REQUIREMENTS = ["sysidentpy>=0.5"]
DEGREES, TERMS, MORE_LAGS = (2, 3, 1), (5, 10, 20, 40, 60), (0, 1, 2, 4)


def fit(data):
    """Lags, degree, number of terms and estimator by the free run over the record's own experiments."""
    end, best, tried, longest = time.monotonic() + 0.8 * data.seconds, None, 0, 0.0
    nb, nf, nk = data.orders or (2, 2, 1)
    u, y = np.concatenate(data.u), np.concatenate(data.y)
    scale = (u.mean(), u.std() or 1.0, y.mean(), y.std() or 1.0)
    parts = [((a - scale[0]) / scale[1], (b - scale[2]) / scale[3]) for a, b in zip(data.u, data.y, strict=True)]
    parts = [(delayed(a, nk), b) for a, b in parts]
    warnings.simplefilter("ignore")
    for more in MORE_LAGS:
        for degree in DEGREES:
            for terms in TERMS:
                for extended in (True, False):
                    began = time.monotonic()
                    if best is not None and began + longest > end:
                        break
                    model = Narx(parts, data.missing, nb + more, max(nf, 1) + more, degree, terms, extended)
                    tried += 1
                    model.scale, model.nk = scale, nk
                    runs = [model.free_run(a, b[: model.lag]) for a, b in parts]
                    seen = [~m for m in data.missing]
                    errors = [(r - b)[m] for r, (_, b), m in zip(runs, parts, seen, strict=True)]
                    model.loss = float(np.nan_to_num(np.mean(np.concatenate(errors) ** 2), nan=np.inf))
                    model.score = model.loss * (1.0 + 2.0 * model.model.n_terms / len(y))  # Akaike's final prediction
                    # A polynomial may explode a little outside its data: such a model gives way to any other one.
                    wild = [np.abs(model.free_run(1.2 * a, b[: model.lag])).max() for a, b in parts]
                    model.score += (
                        0.0 if np.max(wild) < 3.0 * np.abs(np.concatenate([b for _, b in parts])).max() else 1e6
                    )
                    longest = max(longest, time.monotonic() - began)
                    if best is None or model.score < best.score:
                        best = model
    best.details = {"loss": best.loss * scale[3] ** 2, "structure": best.text, "stop": f"best of {tried} models"}
    return best


def delayed(u, nk):
    """The input shifted so that its first lag is 1."""
    k = np.clip(np.arange(len(u)) - (nk - 1), 0, len(u) - 1)
    return u[k]


class Narx:
    def __init__(self, parts, missing, xlag, ylag, degree, terms, extended):
        from sysidentpy.basis_function import Polynomial
        from sysidentpy.model_structure_selection import FROLS
        from sysidentpy.parameter_estimation import LeastSquares
        from sysidentpy.utils.information_matrix import build_lagged_matrix, count_model_regressors

        basis, self.lag = Polynomial(degree=degree), max(xlag, ylag)
        u, y = (np.concatenate(each)[:, None] for each in zip(*parts, strict=True))
        count = count_model_regressors(x=u, y=y, xlag=xlag, ylag=ylag, model_type="NARMAX", basis_function=basis)
        self.model = FROLS(
            order_selection=False,
            n_terms=min(terms, count),
            ylag=ylag,
            xlag=xlag,
            elag=ylag,
            basis_function=basis,
            estimator=LeastSquares(unbiased=extended),
        )
        self.model.fit(X=u, y=y)
        if len(parts) > 1 or any(m.any() for m in missing):
            # The library knows one experiment without gaps: its parameters are estimated again on true rows alone.
            rows, targets, good = [], [], []
            for (a, b), gone in zip(parts, missing, strict=True):
                lagged = build_lagged_matrix(a[:, None], b[:, None], xlag, ylag, "NARMAX")
                chosen = self.model.pivv[: self.model.n_terms]
                psi = basis.fit(lagged, self.lag, ylag, xlag, "NARMAX", predefined_regressors=chosen)
                rows.append(psi)
                targets.append(b[self.lag :])
                good.append(~np.convolve(gone, np.ones(self.lag + 1))[self.lag : len(b)].astype(bool))
            keep = np.concatenate(good)
            self.model.theta = LeastSquares().optimize(
                np.concatenate(rows)[keep], np.concatenate(targets)[keep][:, None]
            )
        self.text = f"degree {degree}, {self.model.n_terms} terms, lags {ylag} of y and {xlag} of u"
        self.text += ", extended least squares" if extended else ""

    def free_run(self, u, first):
        """The run of the library from the last `lag` known outputs (n,), which it repeats."""
        known = len(first) - self.lag
        with np.errstate(all="ignore"):
            run = self.model.predict(X=u[known:, None], y=first[known:, None])
        return np.concatenate([first[:known], np.asarray(run, dtype=float).ravel()])

    def simulate(self, u, y_init):
        u0, su, y0, sy = self.scale
        first = (y_init - y0) / sy
        first = np.concatenate([np.full(max(self.lag - len(first), 0), first[0] if len(first) else 0.0), first])
        added = len(first) - len(y_init)
        u = np.concatenate([np.full(added, u[0]), u])
        return (y0 + sy * self.free_run(delayed((u - u0) / su, self.nk), first))[added:]
