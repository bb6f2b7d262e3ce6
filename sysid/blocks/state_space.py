"""Nonlinear state space: a linear one with a small tanh network, a polynomial or both in its state equation."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.block.block import Block, Law, Slot
from sysid.block.symmetry import Symmetry, direction
from sysid.block.writing import CCode, Code, Writer
from sysid.blocks import _state_space_text as text

_CIRCLE = 1.0 + 1e-9  # eigenvalues of A up to here: an integrator is allowed, but for rounding
_STEPS = 20  # of an input on its way to a steady state, and of Newton's at each
_ACTS = 3.0  # spread of the weights that act on the next state, by that of those that look and by the pace


class Matrices(NamedTuple):
    """The parameters by name; features are the tanh units, then the monomials."""

    A: np.ndarray  # (nx, nx)
    B: np.ndarray  # (nx, nu)
    C: np.ndarray  # (ny, nx)
    D: np.ndarray  # (ny, nu)
    d: np.ndarray  # (ny,)
    E: np.ndarray  # (nx, features)
    F: np.ndarray  # (ny, features), or (ny, 0) without `readout`
    W: np.ndarray  # (units, nx)
    V: np.ndarray  # (units, nu)
    b: np.ndarray  # (units,)
    x0: np.ndarray  # (nx,)


@checked
@dataclass(frozen=True)
class StateSpace(Block):
    """x(t+1) = A x + B v + E f(x, v), z = C x + D v + d + F f(x, v), with v and z the scaled input and output.

    v = (u - u_centre)/u_scale, y = y_centre + y_scale z; empty centres and scales are 0 and 1 until `scaled` takes them
    from a record. f holds tanh(W x + V v + b) - tanh(b) of `units` units and all monomials of x and v of degree 2 to
    `degree`; F is there with `readout`. f(0, 0) = 0: with the input at its centre the state rests at 0. This is the
    polynomial nonlinear state space of Paduart et al. (2010, Automatica 46) with a network beside the polynomial. The
    eigenvalues of A stay within the unit circle; tanh is bounded, so a run without monomials stays bounded too. The
    coordinates of the state are redundant (`symmetries`). `spread` is the size of a weight before a record is seen, and
    `pace` how far the output moves in a sample (`kinks`).
    """

    nx: int = 2
    units: int = 5
    degree: int = 0
    readout: bool = False
    nu: int = 1
    ny: int = 1
    u_centre: tuple[float, ...] = ()
    u_scale: tuple[float, ...] = ()
    y_centre: tuple[float, ...] = ()
    y_scale: tuple[float, ...] = ()
    pace: float = 1.0
    spread: float = 0.3

    def __post_init__(self) -> None:
        for name, least in (("nx", 1), ("units", 0), ("degree", 0), ("nu", 1), ("ny", 1)):
            value = getattr(self, name)
            if not isinstance(value, (int, np.integer)) or value < least:
                raise InputError(f"{name} of a state space is {value!r}; give a whole number of at least {least}")
        for name, n in (("u_centre", self.nu), ("u_scale", self.nu), ("y_centre", self.ny), ("y_scale", self.ny)):
            values = getattr(self, name)
            if len(values) not in (0, n) or not np.all(np.isfinite(values)):
                raise InputError(f"{name} of a state space is {values}; give {n} finite number(s), or none")
            if name.endswith("scale") and 0.0 in values:
                raise InputError(f"{name} of a state space is {values}; give numbers that are not 0")

        for name in ("pace", "spread"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"{name} of a state space is {getattr(self, name)!r}; give a positive number")

    @property
    def channels(self) -> tuple[int, int]:
        return self.nu, self.ny

    @cached_property
    def powers(self) -> np.ndarray:
        """Powers of x and v in each monomial (monomials, nx + nu)."""
        n, rows = self.nx + self.nu, []
        for degree in range(2, self.degree + 1):
            for factors in combinations_with_replacement(range(n), degree):
                rows.append(np.bincount(factors, minlength=n))
        return np.array(rows, dtype=np.int64).reshape(len(rows), n)

    @cached_property
    def features(self) -> int:
        """Number of units and monomials."""
        return self.units + len(self.powers)

    @cached_property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of each of `Matrices`, in the order of theta."""
        nx, nu, ny, m, units = self.nx, self.nu, self.ny, self.features, self.units
        linear = {"A": (nx, nx), "B": (nx, nu), "C": (ny, nx), "D": (ny, nu), "d": (ny,)}
        net = {"E": (nx, m), "F": (ny, m if self.readout else 0), "W": (units, nx), "V": (units, nu), "b": (units,)}
        return linear | net | {"x0": (nx,)}

    @cached_property
    def places(self) -> dict[str, slice]:
        """Position of each of `Matrices` in theta."""
        ends = np.cumsum([int(np.prod(shape)) for shape in self.shapes.values()])
        starts = [0, *ends[:-1].tolist()]
        return {name: slice(a, int(e)) for name, a, e in zip(self.shapes, starts, ends, strict=True)}

    def slots(self) -> tuple[Slot, ...]:
        slots = []
        for name, shape in self.shapes.items():
            for index in np.ndindex(*shape):
                place = ",".join(str(i + 1) for i in index)
                slots.append(Slot(f"{name}_{place}" if name == "x0" else f"{name}{place}", initial=name == "x0"))
        return tuple(slots)

    def split(self, theta: np.ndarray) -> Matrices:
        """theta by matrices, each contiguous."""
        return Matrices(
            **{k: np.ascontiguousarray(theta[self.places[k]].reshape(shape)) for k, shape in self.shapes.items()}
        )

    def joined(self, m: Matrices) -> np.ndarray:
        """The inverse of `split`."""
        return np.concatenate([np.ravel(part) for part in m])

    def scales(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """u_centre, u_scale (nu,), y_centre, y_scale (ny,)."""
        pairs = ((self.u_centre, 0.0, self.nu), (self.u_scale, 1.0, self.nu))
        pairs += ((self.y_centre, 0.0, self.ny), (self.y_scale, 1.0, self.ny))  # type: ignore[assignment]
        u0, us, y0, ys = (np.array(v, dtype=float) if v else np.full(n, plain) for v, plain, n in pairs)
        return u0, us, y0, ys

    def scaled(self, u: np.ndarray | None, y: np.ndarray | None) -> "StateSpace":
        """This block with the centres and scales of u (N, nu) and y (N, ny) where it has none."""
        fresh: dict[str, Any] = {}
        for name, signal in (("u", u), ("y", y)):
            if signal is not None and not getattr(self, f"{name}_scale"):
                pairs = [_scale(column) for column in signal.T]
                fresh[f"{name}_centre"] = tuple(c for c, _ in pairs)
                fresh[f"{name}_scale"] = tuple(s for _, s in pairs)
                if name == "y":
                    fresh["pace"] = _pace(signal)
        return replace(self, **fresh) if fresh else self

    def propagate(self, theta: np.ndarray, x: np.ndarray, J: np.ndarray, q: int) -> np.ndarray:
        return self.propagate_all(theta, [x], [J], q)[0][0]

    def propagate_all(
        self, theta: np.ndarray, xs: list[np.ndarray], Js: list[np.ndarray], q: int
    ) -> tuple[list[np.ndarray], list[np.ndarray]]:
        from sysid.block.kernels_state_space import run, run_tangent

        if len(xs) != self.nu:
            raise InputError(f"{len(xs)} inputs meet a state space of {self.nu}; give as many as its nu")
        u0, us, y0, ys = self.scales()
        m = self.split(theta)
        U = (np.column_stack(xs) - u0) / us
        Z = np.empty((len(U), self.ny))
        if not Js[0].shape[1]:
            run(*m[:-1], self.powers, m.x0, U, Z)
            return _columns(y0 + ys * Z), Js if self.ny == self.nu else [Js[0]] * self.ny
        if self.nu == self.ny == 1:
            out = dU = Js[0][None]
        else:
            out = np.zeros((self.ny, *Js[0].shape))
            dU = np.stack(Js) if q else np.empty((self.nu, len(U), 0))
        run_tangent(*m[:-1], self.powers, m.x0, U, dU, Z, out, q, self.n_parameters, ys, 1.0 / us)
        return _columns(y0 + ys * Z), list(out)

    def states(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state (N, nx) at every sample of the run with the input u (N, nu); nan after it left all bounds."""
        m = self.split(theta)
        D, d, F = np.zeros((self.nx, self.nu)), np.zeros(self.nx), np.zeros((self.nx, 0))
        return self._runs(m._replace(C=np.eye(self.nx), D=D, d=d, F=F), u, m.x0[None])[0]

    def outputs_from(self, theta: np.ndarray, u: np.ndarray, X: np.ndarray) -> np.ndarray:
        """Outputs (M, N, ny) of the runs with the input u (N, nu) from each of the initial states X (M, nx)."""
        _, _, y0, ys = self.scales()
        return y0 + ys * self._runs(self.split(theta), u, X)

    def _runs(self, m: Matrices, u: np.ndarray, X: np.ndarray) -> np.ndarray:
        from sysid.block.kernels_state_space import run

        u0, us, _, _ = self.scales()
        U, Z = np.ascontiguousarray((u - u0) / us), np.empty((len(X), len(u), len(m.C)))
        for x0, out in zip(np.ascontiguousarray(X), Z, strict=True):
            run(*m[:-1], self.powers, x0, U, out)
        return Z

    def rest(self, theta: np.ndarray, u: np.ndarray) -> np.ndarray:
        """The state (nx,) that a constant input u (nu,) keeps: Newton's steps from the rest at the input's centre, at
        once or over smaller inputs. Raises InputError where there is none on this way (an integrator).
        """
        u0, us, _, _ = self.scales()
        v = (np.asarray(u, dtype=float) - u0) / us
        for count in (1, _STEPS):
            x = np.zeros(self.nx)
            for share in np.linspace(0.0, 1.0, count + 1)[1:]:
                x = self._newton(theta, x, share * v)
            if np.all(np.isfinite(x)):
                return x
        raise InputError(f"the state space has no steady state near rest for the constant input {u}; give another one")

    def _newton(self, theta: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """The steady state (nx,) of the scaled input v (nu,) near x (nx,); nan where the search does not end."""
        for _ in range(_STEPS):
            if not np.all(np.isfinite(x)):
                break
            A, _, _, _, gone, _ = self._linear(theta, x, v)
            still = np.eye(self.nx) - A
            if np.abs(np.linalg.det(still)) < 1e-14:
                break
            step = np.linalg.solve(still, gone - x)
            x = x + step
            if np.abs(step).max() < 1e-12 * (1.0 + np.abs(x).max()):
                return x
        return np.full(self.nx, np.nan)

    def linearised(
        self, theta: np.ndarray, u: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A (nx, nx), B (nx, nu), C (ny, nx), D (ny, nu) in the units of u and y around the steady state of a constant
        input u (nu,), and the output there (ny,). Raises InputError where there is no steady state.
        """
        u0, us, y0, ys = self.scales()
        A, B, C, D, _, z = self._linear(theta, self.rest(theta, u), (np.asarray(u, dtype=float) - u0) / us)
        return A, B / us, C * ys[:, None], D * ys[:, None] / us, y0 + ys * z

    def _linear(self, theta: np.ndarray, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
        """A, B, C, D of the tangent at x (nx,) and v (nu,), the next state and the output z there."""
        from sysid.block.kernels_state_space import feature_slopes, features

        m, n = self.split(theta), self.features
        f, g, dx, du = np.empty(n), np.empty(self.units), np.empty((n, self.nx)), np.empty((n, self.nu))
        features(x, v, m.W, m.V, m.b, np.tanh(m.b), self.powers, f, g)
        feature_slopes(x, v, m.W, m.V, g, self.powers, dx, du)
        F = m.F if self.readout else np.zeros((self.ny, self.features))
        z = m.C @ x + m.D @ v + m.d + F @ f
        return m.A + m.E @ dx, m.B + m.E @ du, m.C + F @ dx, m.D + F @ du, m.A @ x + m.B @ v + m.E @ f, z

    def start(self, x: np.ndarray) -> np.ndarray:
        """The scaled input as the scaled output, channel by channel, with states that decay and do nothing."""
        theta = np.zeros(self.n_parameters)
        theta[self.places["A"]] = (0.5 * np.eye(self.nx)).ravel()
        theta[self.places["D"]] = np.eye(self.ny, self.nu).ravel()
        return theta

    def admissible(self, theta: np.ndarray) -> bool:
        return bool(self._radius(theta) <= _CIRCLE)

    def repair(self, theta: np.ndarray) -> np.ndarray:
        """An A with an eigenvalue outside the unit circle is divided by the size of the largest one."""
        radius = self._radius(theta)
        if not np.isfinite(radius) or radius <= _CIRCLE:
            return theta
        fresh = theta.copy()
        fresh[self.places["A"]] /= radius
        return fresh

    def _radius(self, theta: np.ndarray) -> float:
        A = theta[self.places["A"]].reshape(self.nx, self.nx)
        return float(np.abs(np.linalg.eigvals(A)).max()) if np.all(np.isfinite(A)) else np.inf

    def kinks(self, theta: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """The weights of the network by their spread before a record is seen: a ridge on normalised signals.

        A fit weighs each as one error of the noise's size, so that this is the prior of a Gaussian weight.
        """
        spread = np.concatenate(
            [
                np.full(np.prod(self.shapes[name], dtype=int), self.spread * size)
                for name, size in (("E", _ACTS * self.pace), ("F", _ACTS), ("W", 1.0), ("V", 1.0), ("b", 1.0))
            ]
        )
        net = np.r_[self.places["E"].start : self.places["b"].stop]
        return theta[net] / spread, np.eye(len(theta))[net] / spread[:, None]

    def law(self, a: np.ndarray, b: np.ndarray) -> Law | None:
        """The parameters belong to the scaled signals: only the scales change, if the block has any."""
        u0, us, y0, ys = self.scales()
        scales = {"u_centre": u0 / a, "u_scale": us / a, "y_centre": y0 / b, "y_scale": ys / b}
        rescaled = replace(self, **{name: tuple(values.tolist()) for name, values in scales.items()})  # type: ignore[arg-type]
        return Law(rescaled, np.eye(self.n_parameters))

    def symmetries(self, theta: np.ndarray) -> list[Symmetry]:
        """The coordinates of the state; gain and offset of each output; gain of each input that has no centre."""
        m = self.split(theta)
        u0, _, y0, ys = self.scales()
        changes = [Symmetry(self._rotate(m, i, j)) for i in range(self.nx) for j in range(self.nx)]
        for o in range(self.ny):
            unit = np.eye(self.ny)[o]
            row = unit[:, None]
            grown = self._none()._replace(C=row * m.C, D=row * m.D, d=unit * (m.d + y0 / ys), F=row * m.F)
            changes.append(Symmetry(self.joined(grown), out_scale=unit))
            changes.append(Symmetry(self.joined(self._none()._replace(d=unit / ys)), out_shift=unit))
        for i in np.flatnonzero(u0 == 0.0):
            unit = np.eye(self.nu)[i]
            power = np.concatenate([np.zeros(self.units), self.powers[:, self.nx + i]])
            less = self._none()._replace(B=-m.B * unit, D=-m.D * unit, V=-m.V * unit, E=-m.E * power)
            less = less._replace(F=-m.F * power if self.readout else m.F)
            changes.append(Symmetry(self.joined(less), in_scale=unit))
        return changes

    def _none(self) -> Matrices:
        return self.split(np.zeros(self.n_parameters))

    def _rotate(self, m: Matrices, i: int, j: int) -> np.ndarray:
        """The direction of theta in which x_i becomes x_i + eps x_j."""
        M = np.zeros((self.nx, self.nx))
        M[i, j] = 1.0
        T = np.zeros((self.features, self.features))  # the features at the old state, less those at the new one
        for k, row in enumerate(self.powers):
            if row[i]:
                rotated = row.copy()
                rotated[i] -= 1
                rotated[j] += 1
                at = int(np.flatnonzero((self.powers == rotated).all(axis=1))[0])
                T[self.units + k, self.units + at] = row[i]
        F = -m.F @ T if self.readout else m.F
        states = m._replace(A=M @ m.A - m.A @ M, B=M @ m.B, E=M @ m.E - m.E @ T, x0=M @ m.x0)
        return self.joined(states._replace(C=-m.C @ M, D=0 * m.D, d=0 * m.d, F=F, W=-m.W @ M, V=0 * m.V, b=0 * m.b))

    def vary(self, theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The same linear part with another network that does nothing yet: its units look in drawn directions."""
        m = self.split(theta)
        W, V = rng.standard_normal(m.W.shape), rng.standard_normal(m.V.shape)
        size = np.sqrt(np.sum(W**2, axis=1) + np.sum(V**2, axis=1)) if self.units else np.ones(0)
        slope = rng.uniform(0.3, 1.5, self.units) / size
        matrices = m._replace(E=0 * m.E, F=0 * m.F, W=W * slope[:, None], V=V * slope[:, None])
        return self.joined(matrices._replace(b=rng.uniform(-1.0, 1.0, self.units)))

    def c(self, theta: np.ndarray) -> CCode:
        return text.c(self)

    def python(self, theta: np.ndarray) -> Code:
        return text.python(self, theta)

    def equations(self, theta: np.ndarray, w: Writer) -> list[str]:
        return text.equations(self, theta, w)


def _columns(Y: np.ndarray) -> list[np.ndarray]:
    return [np.ascontiguousarray(column) for column in Y.T]


def _scale(x: np.ndarray) -> tuple[float, float]:
    """Mean and standard deviation of x (N,); the latter with a sign that turns with the signal's."""
    return float(np.mean(x)), direction(x) * (float(np.std(x)) or 1.0)


def _pace(Y: np.ndarray) -> float:
    """How far the fastest output of Y (N, ny) moves in a sample, by its standard deviation; at most 1."""
    moves = np.sqrt(np.mean(np.diff(Y, axis=0) ** 2, axis=0)) / np.maximum(np.std(Y, axis=0), 1e-300)
    return float(np.clip(moves.max(), 1e-6, 1.0))
