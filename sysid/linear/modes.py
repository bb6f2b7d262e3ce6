"""Poles as an engineer reads them: natural frequency, damping, time constant, each with its standard deviation.

The deviations are those of the delta method on exact gradients: g' cov g with cov of the fit, or with a record the
covariance that allows for coloured residuals.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.checks import checked
from sysid.base.handlers import Shown
from sysid.base.poles import time_constant
from sysid.blocks import TransferFunction
from sysid.data.record import IOData
from sysid.estimation.result import Fit
from sysid.model.tangents import tangent
from sysid.uncertainty.information import TESTED, Information, information
from sysid.uncertainty.intervals import CANCELLED, is_cancelled

Deviation = Callable[[np.ndarray], float]
_MULTIPLE = 1e-12


@dataclass(frozen=True)
class Mode:
    """A pole in z and in s = ln(z)/Ts [1/s]: natural frequency [rad/s], damping [-], time constant of its envelope [s].

    A standard deviation is nan where the record does not determine it and for a multiple pole. A pole at z = 0 has no
    frequency and no damping (nan); a pole on or outside the unit circle has an infinite time constant. `note` says why
    the record determines nothing of a pole, as in `sysid.uncertainty.intervals.poles`; empty if it does.
    """

    pole: complex
    pole_std: float
    frequency: float
    frequency_std: float
    damping: float
    damping_std: float
    time_constant: float
    time_constant_std: float
    note: str = ""

    @property
    def hertz(self) -> float:
        """Natural frequency [Hz]."""
        return self.frequency / (2.0 * np.pi)

    @property
    def hertz_std(self) -> float:
        """Standard deviation of the natural frequency [Hz]."""
        return self.frequency_std / (2.0 * np.pi)


class Modes(Shown, tuple[Mode, ...]):
    """The modes in the order of `Fit.poles`, a tuple that shows itself as a table."""


@dataclass(frozen=True)
class Gain:
    """Steady-state gain dy/du of the tangent at a constant input u, infinite where the model integrates."""

    value: float
    std: float
    u: float


@checked
def modes(fit: Fit, data: IOData | None = None) -> Modes:
    """The poles of a fit, in the order of `Fit.poles`; of a pair both.

    `data`, the record of the fit, makes the standard deviations allow for coloured residuals and leaves out those of
    poles that a zero may cancel; without it they assume white ones. Raises InputError for a record that is not that of
    the fit.
    """
    info = None if data is None else information(fit, data, lags=TESTED)
    deviation = deviation_of(fit, info)
    results = []
    for F, gradient, block in _denominators(fit):
        slope = np.polyder(F)
        for z in np.roots(F).astype(complex):
            d = np.polyval(slope, z)
            multiple = abs(d) < _MULTIPLE * max(1.0, float(np.abs(F).max()))
            cancelled = info is not None and block is not None and is_cancelled(info, block, z)
            dz = None if multiple or cancelled else -(z ** np.arange(len(F) - 1, -1, -1)) @ gradient / d
            with np.errstate(all="ignore"):  # of a pole near 0 no deviation is known
                mode = _mode(z, dz, fit.Ts, deviation)
            results.append(replace(mode, note=CANCELLED) if cancelled else mode)
    return Modes(results)


@checked
def gain(fit: Fit, u: float | None = None, data: IOData | None = None) -> Gain:
    """The DC gain of the tangent at the constant input `u`, by default 0, or the middle of the input's range where that
    does not hold 0.

    The deviation takes the residuals as white and is too small where they are coloured; with the estimation `data` it
    allows for their colour. Raises InputError for a model without a tangent, such as a motor with friction.
    """
    low, high = fit.u_span
    level = float(u) if u is not None else 0.0 if low <= 0.0 <= high else 0.5 * (low + high)
    G = tangent(fit.model, fit.theta, level)
    if not np.isfinite(G.gain):
        return Gain(np.inf, np.nan, level)
    info = None if data is None else information(fit, data, lags=TESTED)
    return Gain(G.gain, deviation_of(fit, info)(G.gain_gradient), level)


def deviation_of(fit: Fit, info: Information | None = None) -> Deviation:
    """Standard deviation of a quantity from its gradient (P,)."""
    if info is not None:
        return info.std_of_fit
    is_undetermined = fit.covariance.unidentifiable
    return lambda g: float("nan") if np.any(is_undetermined & (np.abs(g) > 0.0)) else fit.covariance.deviation(g)


def _denominators(fit: Fit) -> list[tuple[np.ndarray, np.ndarray, TransferFunction | None]]:
    """F (n + 1,) of every linear block with its gradient (n + 1, P), and the block if it is a filter."""
    if fit._around_centre is not None:
        return [(fit._around_centre.F, fit._around_centre.F_gradient, None)]
    denominators = list[tuple[np.ndarray, np.ndarray, TransferFunction | None]]()
    for part, b in fit.model.dynamics:
        columns = slice(part.start + b.nb, part.start + b.nb + b.nf)
        gradient = np.zeros((b.nf + 1, len(fit.theta)))
        gradient[1:, columns] = np.eye(b.nf)
        denominators.append((np.concatenate([[1.0], fit.theta[columns]]), gradient, b))
    return denominators


def _mode(z: complex, dz: np.ndarray | None, Ts: float, deviation: Deviation) -> Mode:
    nan, z = float("nan"), complex(z)
    r = abs(z)
    lasting = time_constant(r, Ts)
    s = np.log(z) / Ts if r > 0.0 else complex(nan)
    moves = r > 0.0 and s != 0
    frequency = float(abs(s)) if r > 0.0 else nan
    damping = float(-s.real / abs(s)) if moves else nan
    if dz is None:
        return Mode(z, nan, frequency, nan, damping, nan, lasting, nan)
    spread = float(np.hypot(deviation(dz.real), deviation(dz.imag)))
    if not moves:
        return Mode(z, spread, frequency, nan, damping, nan, lasting, nan)
    ds = dz / (z * Ts)
    dw = np.real(np.conj(s) * ds) / abs(s)
    d_damping = -(ds.real * abs(s) - s.real * dw) / abs(s) ** 2
    dr = np.real(np.conj(z) * dz) / r
    longer = deviation(Ts / (np.log(r) ** 2 * r) * dr) if np.isfinite(lasting) else nan
    return Mode(z, spread, frequency, deviation(dw), damping, deviation(d_damping), lasting, longer)
