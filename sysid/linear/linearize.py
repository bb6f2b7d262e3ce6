"""Linear models of a fit: operating point, tangent there, the best linear model for an input, the tangent as a file.

The chain u -> w = f(u) -> x = B/F w -> y = h(x) has the tangent dy = h'(x*) B/F f'(u*) du (Ljung, System Identification
Toolbox user's guide, on linearising Hammerstein-Wiener models).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.poles import Motion, motion
from sysid.block.writing import number
from sysid.blocks import Process, StateSpace
from sysid.estimation.result import Fit
from sysid.model.tangents import tangent as rational
from sysid.nlarx import linearize as nlarx_linearize
from sysid.nlarx.result import NlarxFit

if TYPE_CHECKING:
    from control import StateSpace as ControlStateSpace
    from control import TransferFunction


@dataclass(frozen=True)
class OperatingPoint:
    """Steady state of a chain at a constant input: u, w = f(u), x, y = h(x) and the slopes f'(u), h'(x)."""

    u: float
    w: float
    x: float
    y: float
    input_slope: float
    output_slope: float


@checked
def findop(fit: Fit, u: float = 0.0, x: float | None = None) -> OperatingPoint:
    """Steady state at the constant input u, or the point with linear output x if x is given.

    Raises InputError if the linear block integrates and w is not zero: such a chain has no steady state; give x.
    """
    model, linear = fit.model, fit.model.linear
    k = model.blocks.index(linear)
    w, input_slope = _static_point(fit, 0, k, u)
    if x is None:
        gain = linear.gain(model.part(fit.theta, linear))
        if not np.isfinite(gain):
            raise InputError("the linear block integrates, so a constant input has no steady state; give x instead")
        x = gain * w
    y, output_slope = _static_point(fit, k + 1, len(model.blocks), x)
    return OperatingPoint(float(u), w, float(x), y, input_slope, output_slope)


@checked
def tangent(fit: Fit | NlarxFit, u: float = 0.0, x: float | None = None) -> "TransferFunction":
    """The fit's tangent at the operating point of constant input u, as a discrete control.TransferFunction.

    For a nonlinear ARX fit use `sysid.nlarx.linearize`; it may have several steady states.
    """
    from sysid.base.looks import load

    load()  # matplotlib, which control imports, whatever its settings are
    import control

    if isinstance(fit, NlarxFit):
        return nlarx_linearize.tangent(fit, u)

    B, F = fraction(fit, u, x)
    B = np.trim_zeros(B, "f")
    return control.tf(B if len(B) else np.zeros(1), F, fit.Ts)


def fraction(fit: Fit, u: float = 0.0, x: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """B and F (n + 1,) of the tangent at the operating point of constant input u, as `scipy.signal.lfilter` has them.

    Raises InputError where the model has no operating point there.
    """
    if any(isinstance(b, StateSpace | Process) for b in fit.model.blocks):
        G = rational(fit.model, fit.theta, u)
        longer = len(G.F) - len(G.B)  # negative with a delay, whose poles are at zero
        return np.pad(G.B, (max(longer, 0), 0)), np.pad(G.F, (0, max(-longer, 0)))
    op = findop(fit, u, x)
    B, F = fit.model.linear.padded(fit.model.part(fit.theta, fit.model.linear))
    return B * op.input_slope * op.output_slope, F


def tangent_ss(fit: Fit, u: float = 0.0, x: float | None = None) -> "ControlStateSpace":
    """The same as a control.StateSpace in controllable companion form, as the paper's equations (6), (8), (10)."""
    from sysid.base.looks import load

    load()  # matplotlib, which control imports, whatever its settings are
    import control

    op = findop(fit, u, x)
    B, F = fit.model.linear.padded(fit.model.part(fit.theta, fit.model.linear))
    n = len(F) - 1
    A = np.eye(n, k=-1)
    if n:
        A[0] = -F[1:]
    b = np.zeros((n, 1))
    if n:
        b[0] = op.input_slope
    c = op.output_slope * (B[1:] - B[0] * F[1:])
    return control.ss(A, b, c[None, :], [[op.output_slope * B[0] * op.input_slope]], fit.Ts)


@checked
def linapp(fit: Fit, u: np.ndarray) -> "TransferFunction":
    """The output-error model of the same orders that is closest to the fit's free run for the input u (N,).

    Valid for inputs like this one only (section III.F of Guni and Irawan 2016).
    """
    from sysid.base.looks import load

    load()  # matplotlib, which control imports, whatever its settings are
    import control

    from sysid.data.record import IOData
    from sysid.estimation.fit import fit_chain
    from sysid.structures import output_error

    linear = fit.model.linear
    y = fit.simulate(np.asarray(u, dtype=float))
    data = IOData(np.asarray(u) - np.mean(u), y - y.mean(), fit.Ts)
    best = fit_chain(output_error(linear.nb, linear.nf, linear.nk), data, search="lm")
    B, F = best.model.linear.padded(best.theta)
    return control.tf(np.trim_zeros(B, "f"), F, fit.Ts)


def _static_point(fit: Fit, start: int, stop: int, value: float) -> tuple[float, float]:
    """Value and slope of the static blocks start..stop-1 at one point."""
    x, J = np.array([float(value)]), np.ones((1, 1))
    for b in fit.model.blocks[start:stop]:
        p = b.n_parameters
        wide: Any = np.column_stack([J, np.zeros((1, p))])
        x = b.propagate(fit.model.part(fit.theta, b), x, wide, 1)
        J = wide[:, :1].copy()
    return float(x[0]), float(J[0, 0])


@dataclass(frozen=True)
class Tangent:
    """B / F in z^-1 order of `control` (highest power first) at the input u and output y, on the scale of the record.

    `integrates` says that no steady state exists: y is then where the output stands, whatever the input.
    """

    B: np.ndarray
    F: np.ndarray
    Ts: float
    u: float
    y: float
    integrates: bool = False

    def as_dict(self) -> dict[str, Any]:
        """All values, ready for JSON."""
        return {**vars(self), "B": self.B.tolist(), "F": self.F.tolist()}


def tangent_at(fit: Fit | NlarxFit, u: float | None = None) -> Tangent:
    """The tangent at the constant input u of the record's scale; by default at the middle of the estimation data's.

    Raises InputError for several inputs or outputs, a chain without one linear block, and an input without a steady
    state.
    """
    if isinstance(fit, Fit) and fit.model.channels != (1, 1):
        raise InputError(
            f"the model has {fit.model.channels[0]} input(s) and {fit.model.channels[1]} output(s); a transfer "
            "function is written for one of each"
        )
    if isinstance(fit, Fit):
        _check_linear(fit)
    u0, y0 = (0.0 if o is None else float(o[0]) for o in (fit.u_offset, fit.y_offset))
    level = 0.5 * sum(fit.u_span) if u is None else u - u0
    integrates = _integrates(fit)
    if isinstance(fit, NlarxFit):
        G, y = tangent(fit, level), nlarx_linearize.findop(fit, level).y
    elif any(isinstance(b, StateSpace | Process) for b in fit.model.blocks):
        G, y = tangent(fit, level), float(np.ravel(fit.simulate(np.full(5000, level)))[-1])
    else:
        G, y = (
            tangent(fit, level, 0.0 if integrates else None),
            findop(fit, level, 0.0 if integrates else None).y,
        )
    return Tangent(np.array(G.num[0][0]), np.array(G.den[0][0]), fit.Ts, level + u0, y + y0, integrates)


def _check_linear(fit: Fit) -> None:
    n = len(fit.model.dynamics)
    if n != 1 and not any(isinstance(b, StateSpace | Process) for b in fit.model.blocks):
        raise InputError(
            f"a linear model is written of a chain with one transfer function, and {fit.model.structure or 'this one'} "
            f"has {n or 'none'}; fit such a one to the same log, for example qpal identify LOG --structure output_error"
        )


def _integrates(fit: Fit | NlarxFit) -> bool:
    if isinstance(fit, NlarxFit) or len(fit.model.dynamics) != 1:
        return False
    part, block = fit.model.dynamics[0]
    return motion(block.poles(fit.theta[part])) == Motion.INTEGRATES


def tangent_source(model: Tangent, structure: str) -> str:
    """Text of a Python module that needs python-control: G, and the operating point U0, Y0."""
    place = "no steady state: the model integrates" if model.integrates else "its steady state"
    return f'''"""Linear model of {structure} about the input U0 and the output Y0 ({place}).

G takes deviations of the input from U0 and gives deviations of the output from Y0.
"""

import control

TS = {number(model.Ts)}  # s
U0 = {number(model.u)}
Y0 = {number(model.y)}
G = control.TransferFunction(
    [{", ".join(number(b) for b in model.B)}],
    [{", ".join(number(f) for f in model.F)}],
    TS,
)

if __name__ == "__main__":
    print(G)
    print("poles", control.poles(G))
    print("DC gain", control.dcgain(G))
'''
