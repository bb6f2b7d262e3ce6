"""Linear block B(q)/F(q) with delay and an estimated initial state."""

from dataclasses import dataclass

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.poles import ROUNDING, monic
from sysid.block.block import Block, Law, Piecewise, Slot
from sysid.block.symmetry import Symmetry
from sysid.block.writing import CCode, Code, Writer, number

_CLUSTER = 1e-6  # a double integrator's computed poles stand about this far from 1, inside or outside
_NOTHING = 1e-200  # smaller remnants of an initial state become zero: denormal numbers are slow
STABILITY = ("stable", "free")


@checked(deferred=("nb", "nf", "nk"))
@dataclass(frozen=True)
class TransferFunction(Block):
    """x_t + f1 x_{t-1} + ... + f_nf x_{t-nf} = b0 w_{t-nk} + ... + b_{nb-1} w_{t-nk-nb+1} + x0_t.

    nb coefficients of B, nf of F, a delay of nk samples. The last term acts in the first n = max(nf, nk + nb - 1)
    samples and includes the full effect of the past, so x0 (n,) is a full initial state. With stability 'stable' no
    pole leaves the unit circle (an integrator is allowed); with 'free' poles may leave it.
    """

    nb: int = 2
    nf: int = 3
    nk: int = 1
    initial_state: bool = True
    stability: str = "stable"

    def __post_init__(self) -> None:
        orders = (self.nb, self.nf, self.nk)
        if not all(isinstance(k, (int, np.integer)) for k in orders) or self.nb < 1 or self.nf < 0 or self.nk < 0:
            raise InputError(f"orders nb, nf, nk are {orders}; give integers with nb >= 1, nf >= 0 and nk >= 0")
        if self.stability not in STABILITY:
            raise InputError(f"stability is {self.stability!r}; choose one of {', '.join(STABILITY)}")

    @property
    def n_state(self) -> int:
        """Length of the initial state."""
        return max(self.nf, self.nk + self.nb - 1)

    @property
    def states(self) -> slice:
        """Positions of the initial state in theta, where it is a parameter."""
        return slice(self.nb + self.nf, self.nb + self.nf + self.n_state)

    @property
    def orders(self) -> dict[str, int]:
        """Its orders by name, in the order in which people give them."""
        return {"nb": self.nb, "nf": self.nf, "nk": self.nk}

    def slots(self) -> tuple[Slot, ...]:
        b = [Slot(f"b{i}") for i in range(self.nb)]
        f = [Slot(f"f{j + 1}") for j in range(self.nf)]
        x0 = [Slot(f"x0_{i}", initial=True) for i in range(self.n_state if self.initial_state else 0)]
        return (*b, *f, *x0)

    def split(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """b (nb,), f (nf,) and the initial state (n_state,) out of theta."""
        x0 = theta[self.states] if self.initial_state else np.zeros(self.n_state)
        return theta[: self.nb], theta[self.nb : self.nb + self.nf], x0

    def padded(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """B (n_state + 1,) with the delay as leading zeros, and F (n_state + 1,) with its leading one."""
        b, f, _ = self.split(theta)
        B, F = np.zeros(self.n_state + 1), np.zeros(self.n_state + 1)
        B[self.nk : self.nk + self.nb] = b
        F[0], F[1 : self.nf + 1] = 1.0, f
        return B, F

    def poles(self, theta: np.ndarray) -> np.ndarray:
        """Roots of F in z (nf,), complex."""
        return np.roots(np.concatenate([[1.0], self.split(theta)[1]])).astype(complex)

    def zeros(self, theta: np.ndarray) -> np.ndarray:
        """Finite roots of B in z, complex; leading zero coefficients of B are dropped."""
        return np.roots(self.split(theta)[0]).astype(complex)

    def gain(self, theta: np.ndarray) -> float:
        """B(1)/F(1); infinite with a pole at 1 but for rounding."""
        b, f, _ = self.split(theta)
        F1 = 1.0 + f.sum()
        return float(b.sum() / F1) if abs(F1) > ROUNDING else np.inf

    def lowered(self, theta: np.ndarray, level: float) -> np.ndarray:
        """theta for an input that is lower by `level`: the output is lower by gain times level, from its first sample.

        A constant input u and output y need the initial state y (1 + f1 + ... + ft) - u (b0 + ... + bt).
        """
        gain = self.gain(theta)
        if not self.initial_state or not np.isfinite(gain):
            return theta
        B, F = self.padded(theta)
        changed = theta.copy()
        changed[self.states] -= level * (gain * np.cumsum(F) - np.cumsum(B))[:-1]
        return changed

    def admissible(self, theta: np.ndarray) -> bool:
        if self.stability == "free" or self.nf == 0:
            return True
        if _inside(self.split(theta)[1].tolist()):
            return True
        poles = self.poles(theta)
        near_one = np.abs(poles - 1.0) < _CLUSTER
        return bool(np.all((np.abs(poles) <= 1.0 + 1e-12) | near_one))

    def basis(self) -> np.ndarray:
        """Coefficients in powers of (z - 1) in place of z (the delta operator, Middleton and Goodwin 1990).

        With fast sampling the poles are close to z = 1, where the coefficients of F(z) nearly cancel. In this basis
        F(1), which sets the static gain, is a separate coefficient, and the damping of Levenberg-Marquardt
        distinguishes slow from fast dynamics.
        """
        M = np.eye(self.n_parameters)
        for start, n in ((0, self.nb), (self.nb, self.nf)):
            # Row i of a coefficient vector stands for z^(n-1-i); column k for (z - 1)^(n-1-k).
            for k in range(n):
                M[start + k : start + n, start + k] = np.poly(np.ones(n - 1 - k))
        return M

    def at_low(self, theta: np.ndarray) -> np.ndarray:
        """F(1) = 0, an integrator: below it a real pole leaves the unit circle."""
        low = super().at_low(theta)
        if self.stability == "stable" and self.nf:
            low[self.nb + self.nf - 1] = 1.0 + self.split(theta)[1].sum() <= 1e-14  # exact but for rounding
        return low

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """A real pole beyond 1 is moved to 1: F(1) < 0 becomes 0; the other coefficients in (z - 1) do not change."""
        excess = 1.0 + self.split(theta)[1].sum()
        if self.stability != "stable" or not self.nf or excess >= 0.0:
            return theta
        repaired = theta.copy()
        repaired[self.nb + self.nf - 1] -= excess
        return repaired

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        from sysid.block.kernels import all_pole, filter_tangent, lagged

        B, F = self.padded(theta)
        _, f, x0 = self.split(theta)
        y = np.empty_like(x)
        filter_tangent(B, F[1:], x0, x, y, J, q if J.shape[1] else 0)
        if J.shape[1]:
            # d/db_i is w/F delayed, d/df_j is -y/F delayed, d/dx0_i is 1/F's impulse response delayed.
            g = np.empty_like(x)
            all_pole(f, x, g)
            for i in range(self.nb):
                lagged(g, self.nk + i, 1.0, J, q + i)
            all_pole(f, y, g)
            for j in range(self.nf):
                lagged(g, j + 1, -1.0, J, q + self.nb + j)
            impulse = np.zeros_like(x)
            impulse[:1] = 1.0
            all_pole(f, impulse, g)
            for i in range(len(x0) if self.initial_state else 0):
                lagged(g, i, 1.0, J, q + self.nb + self.nf + i)
            J[:, q + self.states.stop : q + self.n_parameters] = 0.0  # those of an estimator, which no free run has
        return y

    def piecewise(self, theta: np.ndarray, q: int, P: int) -> Piecewise | None:
        return _PieceFilter(self, theta, q, P)

    def c(self, theta: np.ndarray) -> CCode:
        """Transposed direct form II in the order of the library's own kernel, so that rounding agrees too."""
        n, nb, nf, nk = self.n_state, self.nb, self.nf, self.nk
        fields: dict[str, int | tuple[int, ...]] = {"b": tuple(range(nb))}
        fields |= {"f": tuple(range(nb, nb + nf))} if nf else {}
        if n == 0:
            return CCode("return p->b[0] * x;", fields=fields)
        now, first = (" + p->b[0] * x", 1) if nk == 0 else ("", 0)
        lines = [f"const double y = s->past[0]{now};"]
        lines += [f"for (int i = 0; i < {n - 1}; ++i) s->past[i] = s->past[i + 1];"] if n > 1 else []
        lines.append(f"s->past[{n - 1}] = 0.0;")
        places = f"i + {nk - 1}" if nk > 1 else "i" if nk == 1 else "i - 1"
        if first < nb:
            lines.append(f"for (int i = {first}; i < {nb}; ++i) s->past[{places}] += p->b[i] * x;")
        lines += [f"for (int i = 0; i < {nf}; ++i) s->past[i] -= p->f[i] * y;"] if nf else []
        return CCode("\n".join([*lines, "return y;"]), {"past": n}, fields, feeds=nk == 0)

    def python(self, theta: np.ndarray) -> Code:
        B, F = self.padded(theta)
        n = self.n_state
        if n == 0:
            return Code(f"return {number(B[0])} * x")
        body = f"""y = s[0] + B[0] * x
for i in range({n}):
    s[i] = s[i + 1] + B[i + 1] * x - F[i] * y
return y"""
        return Code(body, n + 1, {"B": B, "F": F[1:]})

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        b, f, _ = self.split(theta)
        past = [(-value, f"{w.y}(t-{j})") for j, value in enumerate(f, 1)]
        now = [(value, f"{w.x}(t-{self.nk + i})" if self.nk + i else f"{w.x}(t)") for i, value in enumerate(b)]
        B = w.sum([(value, f"z^-{self.nk + i}" if self.nk + i else "") for i, value in enumerate(b)])
        F = w.sum([(1.0, ""), *((value, f"z^-{j}") for j, value in enumerate(f, 1))])
        return [
            f"{w.y}(t) = {w.sum(now + past)}",
            f"  B(z) = {B}",
            f"  F(z) = {F}",
            f"  poles {_roots(self.poles(theta))}; zeros {_roots(self.zeros(theta))}; "
            f"gain at rest {self.gain(theta):.6g}",
        ]

    def start(self, x: np.ndarray) -> np.ndarray:
        theta = np.zeros(self.n_parameters)
        theta[0] = 1.0
        return theta

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        n = self.n_parameters - self.nb - self.nf
        return Law(self, np.diag(np.repeat([b[0] / a[0], 1.0, b[0]], [self.nb, self.nf, n])))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        b, _, x0 = self.split(theta)
        scaling = np.zeros_like(theta)
        scaling[: self.nb] = b
        scale_in, scale_out = -scaling, scaling.copy()
        if self.initial_state:
            scale_out[self.nb + self.nf :] = x0
        changes = [Symmetry(scale_in, in_scale=1.0), Symmetry(scale_out, out_scale=1.0)]
        if self.initial_state or self.n_state == 0:
            changes.append(self._shift(theta))
        return changes

    def _shift(self, theta: np.ndarray) -> Symmetry:
        """A constant at the input adds its static gain at the output, if the initial state is adapted.

        Both are scaled by F(1), so that a pole at 1 (infinite gain) needs no special case.
        """
        B, F = self.padded(theta)
        F1, B1 = F.sum(), B.sum()
        d_theta = np.zeros_like(theta)
        if self.initial_state:
            d_theta[self.nb + self.nf :] = (np.cumsum(F) * B1 - np.cumsum(B) * F1)[:-1]
        return Symmetry(d_theta, in_shift=F1, out_shift=B1)

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The same poles with other time constants (probability 2/3), or new random poles.

        Time constants change by a factor of about 1.6; new ones are log-uniform from one to a thousand samples, some
        in complex pairs, some real and negative.
        """
        fresh = theta.copy()
        poles = self.stretched(theta, rng) if rng.uniform() < 2 / 3 else _drawn(self.nf, rng)
        fresh[self.nb : self.nb + self.nf] = monic(poles)
        fresh[self.nb + self.nf :] = 0.0
        return fresh

    def stretched(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Poles with |z| raised to a power each, the same for both of a complex pair."""
        poles = self.poles(theta)
        powers = np.exp(0.5 * rng.normal(size=len(poles)))
        for k in range(1, len(poles)):
            if poles[k].imag and poles[k] == poles[k - 1].conjugate():
                powers[k] = powers[k - 1]
        size = np.where(poles == 0.0, 1.0, np.abs(poles))  # a delay stays one
        return poles * size ** (powers - 1.0)


class _PieceFilter:
    """The filter, its tangent and the filtered signals of its own columns, with their states between pieces."""

    def __init__(self, block: TransferFunction, theta: np.ndarray, q: int, P: int) -> None:
        self.block, self.q, self.own = block, q if P else 0, P > 0
        self.B, F = block.padded(theta)
        self.F = F[1:]
        _, self.f, self.x0 = block.split(theta)
        n = block.n_state
        self.s, self.S = np.zeros(n + 1), np.zeros((n + 1, self.q))
        self.past = max(n, 1)  # samples before a piece that its own columns refer to
        self.filtered = [np.zeros(self.past) for _ in range(3)]
        self.first = 0  # sample of the record at which the next piece begins

    def __call__(self, x: np.ndarray, J: np.ndarray) -> np.ndarray:
        from sysid.block.kernels import filter_piece

        y = np.empty_like(x)
        filter_piece(self.B, self.F, self.x0, self.first, x, y, J, self.q, self.s, self.S)
        if self.own:
            self._own_columns(x, y, J)
        self.S[np.abs(self.S) < _NOTHING] = 0.0
        self.first += len(x)
        return y

    def _own_columns(self, x: np.ndarray, y: np.ndarray, J: np.ndarray) -> None:
        """As in `TransferFunction.propagate`, from w/F, -y/F and the impulse response of 1/F."""
        block, past, n = self.block, self.past, len(x)
        impulse = np.zeros_like(x)
        impulse[:1] = self.first == 0
        g_x, g_y, g_0 = (self._filter(k, signal) for k, signal in enumerate((x, y, impulse)))
        for i in range(block.nb):
            J[:, self.q + i] = g_x[past - block.nk - i :][:n]
        for j in range(block.nf):
            J[:, self.q + block.nb + j] = -g_y[past - j - 1 :][:n]
        for i in range(len(self.x0) if block.initial_state else 0):
            J[:, self.q + block.nb + block.nf + i] = g_0[past - i :][:n]

    def _filter(self, k: int, signal: np.ndarray) -> np.ndarray:
        """The signal (n,) through 1/F, after the outputs before this piece (past + n,)."""
        from sysid.block.kernels import all_pole_after

        previous = self.filtered[k]
        g = np.concatenate([previous, np.empty_like(signal)])
        if signal.any() or previous.any():
            all_pole_after(self.f, signal, g, self.past)
        else:
            g[self.past :] = 0.0
        self.filtered[k] = g[len(signal) :].copy()
        self.filtered[k][np.abs(self.filtered[k]) < _NOTHING] = 0.0
        return g


def _inside(f: list[float]) -> bool:
    """True where all roots of z^n + f1 z^(n-1) + ... lie inside the unit circle (Schur-Cohn; faster than roots)."""
    a = [1.0, *f]
    for m in range(len(f), 0, -1):
        k = a[m]
        if not abs(k) < 1.0:
            return False
        a = [(a[i] - k * a[m - i]) / (1.0 - k * k) for i in range(m)]
    return True


def _drawn(n: int, rng: np.random.Generator) -> np.ndarray:
    poles: list[complex] = []
    while len(poles) < n:
        radius = float(np.exp(-1.0 / 10 ** rng.uniform(0.0, 3.0)))
        if n - len(poles) >= 2 and rng.uniform() < 0.3:
            angle = rng.uniform(0.02, 3.0)
            poles += [radius * np.exp(1j * angle), radius * np.exp(-1j * angle)]
        else:
            poles.append(radius if rng.uniform() < 0.8 else -radius)
    return np.array(poles)


def _roots(roots: np.ndarray) -> str:
    if not len(roots):
        return "none"
    shown = []
    for z in roots:
        if abs(z.imag) < 1e-12:
            shown.append(f"{z.real:.6g}")
        elif z.imag > 0:
            shown.append(f"{z.real:.6g} +- {z.imag:.6g}i")
    return ", ".join(shown)
