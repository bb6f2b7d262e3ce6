"""A fit's tangent as a Python file that makes a control.TransferFunction, ready to design on."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.block.writing import number
from sysid.blocks import StateSpace
from sysid.estimation.result import Fit
from sysid.linear.linearize import findop
from sysid.linear.linearize import tangent as tangent_of
from sysid.nlarx import linearize as nlarx_linearize
from sysid.nlarx.result import NlarxFit


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
    own = 0.5 * sum(fit.u_span) if u is None else u - u0
    integrates = _integrates(fit)
    if isinstance(fit, NlarxFit):
        G, y = tangent_of(fit, own), nlarx_linearize.findop(fit, own).y
    elif any(isinstance(b, StateSpace) for b in fit.model.blocks):
        G, y = tangent_of(fit, own), float(np.ravel(fit.simulate(np.full(5000, own)))[-1])
    else:
        G, y = (
            tangent_of(fit, own, 0.0 if integrates else None),
            findop(fit, own, 0.0 if integrates else None).y,
        )
    return Tangent(np.array(G.num[0][0]), np.array(G.den[0][0]), fit.Ts, own + u0, y + y0, integrates)


def _check_linear(fit: Fit) -> None:
    n = len(fit.model.dynamics)
    if n != 1 and not any(isinstance(b, StateSpace) for b in fit.model.blocks):
        raise InputError(
            f"a linear model is written of a chain with one transfer function, and {fit.model.structure or 'this one'} "
            f"has {n or 'none'}; fit such a one to the same log, for example qpal identify LOG --structure output_error"
        )


def _integrates(fit: Fit | NlarxFit) -> bool:
    if isinstance(fit, NlarxFit) or len(fit.model.dynamics) != 1:
        return False
    part, block = fit.model.dynamics[0]
    return not np.isfinite(block.gain(fit.theta[part]))


def source(found: Tangent, structure: str) -> str:
    """Text of a Python module that needs python-control: G, and the operating point U0, Y0."""
    where = "no steady state: the model integrates" if found.integrates else "its steady state"
    return f'''"""Linear model of {structure} about the input U0 and the output Y0 ({where}).

G takes deviations of the input from U0 and gives deviations of the output from Y0.
"""

import control

TS = {number(found.Ts)}  # s
U0 = {number(found.u)}
Y0 = {number(found.y)}
G = control.TransferFunction(
    [{", ".join(number(b) for b in found.B)}],
    [{", ".join(number(f) for f in found.F)}],
    TS,
)

if __name__ == "__main__":
    print(G)
    print("poles", control.poles(G))
    print("DC gain", control.dcgain(G))
'''
