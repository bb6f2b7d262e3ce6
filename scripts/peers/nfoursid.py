"""nfoursid: linear state space by subspace identification (N4SID)."""

import time

import numpy as np

REQUIREMENTS = ["nfoursid>=1.0.2"]
# The library makes a square matrix of as many rows as there are samples.
LONGEST = 5000


def fit(data):
    """Several numbers of block rows and orders; the model whose free run is nearest to the data wins."""
    import pandas as pd
    from nfoursid.nfoursid import NFourSID

    end, best = time.monotonic() + 0.8 * data.seconds, None
    longest = max(range(len(data.u)), key=lambda k: len(data.u[k]))
    u, y = np.concatenate(data.u), np.concatenate(data.y)
    scale = (u.mean(), u.std() or 1.0, y.mean(), y.std() or 1.0)
    seen = [~m for m in data.missing]
    piece = slice(0, LONGEST)
    table = {"u": (data.u[longest][piece] - scale[0]) / scale[1], "y": (data.y[longest][piece] - scale[2]) / scale[3]}
    orders = (
        sorted({max(data.orders[1], 1), max(data.orders[1], 1) + max(data.orders[2] - 1, 0)})
        if data.orders
        else range(1, 7)
    )
    for rows in (10, 15, 20, 30, 5):
        if 4 * rows > len(table["u"]) or (best is not None and time.monotonic() > end):
            continue
        subspace = NFourSID(pd.DataFrame(table), output_columns=["y"], input_columns=["u"], num_block_rows=rows)
        subspace.subspace_identification()
        for n in (n for n in orders if 1 <= n < rows):
            found, _ = subspace.system_identification(rank=n)
            model = StateSpace(found.a, found.b, found.c, found.d, scale)
            model.offset(data.u, data.y, seen)
            loss = float(np.mean(model.errors(data.u, data.y, seen) ** 2))
            if np.isfinite(loss) and (best is None or loss < best.details["loss"]):
                parts = f"the first {LONGEST} samples" if len(data.u[longest]) > LONGEST else "all samples"
                parts += f" of experiment {longest + 1} of {len(data.u)}" if len(data.u) > 1 else ""
                model.details = {"loss": loss, "structure": f"order {n}, {rows} block rows", "stop": parts}
                best = model
    if best is None:
        raise ValueError("no number of block rows gave a stable model")
    return best


class StateSpace:
    def __init__(self, a, b, c, d, scale):
        self.a, self.b, self.c, self.d, self.scale = a, b.ravel(), c.ravel(), float(d.squeeze()), scale
        self.poles = np.linalg.eigvals(a)

    def errors(self, u, y, seen):
        """Of the free runs, whose first state is fitted to the first samples, as it is in a test."""
        runs = [self.simulate(a, b[: 10 * len(self.b)]) for a, b in zip(u, y, strict=True)]
        return np.concatenate([(r - b)[m] for r, b, m in zip(runs, y, seen, strict=True)])

    def offset(self, u, y, seen):
        """The means of u and y need not belong together, in a record that begins at rest for one."""
        u0, su, y0, sy = self.scale
        self.scale = u0, su, y0 - float(np.mean(self.errors(u, y, seen))), sy

    def simulate(self, u, y_init):
        """The state at the start is the least-squares one for the first outputs."""
        u0, su, y0, sy = self.scale
        u, first, n = (u - u0) / su, (y_init - y0) / sy, len(self.b)
        if len(first) >= n:
            rest = first - self._run(np.zeros(n), u[: len(first)])
            free = np.stack([self._run(x, np.zeros(len(first))) for x in np.eye(n)], axis=1)
            x0 = np.linalg.lstsq(np.nan_to_num(free), np.nan_to_num(rest), rcond=None)[0]
        else:
            x0 = np.zeros(n)
        return y0 + sy * self._run(x0, u)

    def _run(self, x, u):
        out = np.empty(len(u))
        with np.errstate(all="ignore"):
            for k, now in enumerate(u):
                out[k] = self.c @ x + self.d * now
                x = self.a @ x + self.b * now
        return out
