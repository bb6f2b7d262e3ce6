"""SciPy's least_squares on the stated model, with its derivatives by differences: a method file for bench certify."""

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import lfilter

REQUIREMENTS: list[str] = []
PACKAGE = "scipy"


def fit(data):
    """A search from the record's start. Refuses a record without a stated model, and one with a motor."""
    if data.model is None:
        raise NotImplementedError("the record states no model")
    kinds = {block["kind"] for block in data.model["blocks"]}
    if not kinds <= KINDS.keys():
        raise NotImplementedError(f"no {', '.join(sorted(kinds - KINDS.keys()))} here")
    return Model(data.model, data.u[0], data.y[0])


def filtered(block, v, x):
    """B(q)/F(q) from rest."""
    B = [0.0] * block["nk"] + [v[f"b{i}"] for i in range(block["nb"])]
    return lfilter(B, [1.0, *(v[f"f{j + 1}"] for j in range(block["nf"]))], x)


def played(block, v, x):
    """Backlash."""
    y = np.array(x)
    for k in range(1, len(x)):
        y[k] = min(max(y[k - 1], x[k] - v["width"] / 2), x[k] + v["width"] / 2)
    return y


KINDS = {
    "transfer_function": filtered,
    "saturation": lambda block, v, x: np.minimum(np.maximum(x, v["lower"]), v["upper"]),
    "polynomial": lambda block, v, x: np.polyval([v[f"c{i + 1}"] for i in range(block["degree"] + 1)], x),
    "play": played,
}


class Model:
    """The stated model at the estimate."""

    def __init__(self, stated, u, y):
        self.stated, names = stated, list(stated["start"])
        start = [stated["start"][name] for name in names]

        def errors(p):
            with np.errstate(all="ignore"):
                e = self.run(dict(zip(names, p, strict=True)), u) - y
            return np.nan_to_num(e, nan=1e9, posinf=1e9, neginf=-1e9)

        tight = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "max_nfev": 500}
        found = least_squares(errors, start, "3-point", x_scale="jac", **tight)
        self.values = dict(zip(names, found.x.tolist(), strict=True))
        cov = np.linalg.pinv(found.jac.T @ found.jac) * 2.0 * found.cost / (len(y) - len(names))
        deviations = dict(zip(names, np.sqrt(np.diag(cov)).tolist(), strict=True))
        self.details = {"values": self.values, "deviations": deviations, "stop": found.message}

    def run(self, values, u):
        """Free run from rest."""
        known = {**self.stated["fixed"], **values}
        for block in self.stated["blocks"]:
            v = {name.split(".")[1]: value for name, value in known.items() if name.split(".")[0] == block["role"]}
            u = KINDS[block["kind"]](block, v, u)
        return u

    def simulate(self, u, y_init):
        """See the contract."""
        return self.run(self.values, u)
