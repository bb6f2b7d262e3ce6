"""Responses of a fit's tangent with bands: step, impulse, frequency response. All are independent of the gauge."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.estimation.frequency_fit import ResponseFit
from sysid.model.tangents import Rational, tangent
from sysid.uncertainty.information import Information
from sysid.uncertainty.intervals import Band, band

_OPEN = 230.0  # of log |G|: a factor of 1e100


@dataclass(frozen=True)
class FrequencyResponse:
    """Magnitude [-] and phase [deg] of the tangent over angular frequencies w (n,) [rad/s]; bands on both."""

    magnitude: Band
    phase: Band


@checked
def step(info: Information, u: float = 0.0, samples: int | None = None, level: float = 0.95) -> Band:
    """Output over time [s] for a unit step of the input at the operating point u."""
    G = tangent(info.chain, info.theta, u)
    return _response_band(info, G, np.ones(_length(G, samples)), level)


@checked
def impulse(info: Information, u: float = 0.0, samples: int | None = None, level: float = 0.95) -> Band:
    """Output over time [s] for one sample of 1 at the operating point u (a pulse of one Ts, not a Dirac)."""
    G = tangent(info.chain, info.theta, u)
    return _response_band(info, G, np.eye(1, _length(G, samples))[0], level)


@checked
def frequency(info: Information, u: float = 0.0, w: np.ndarray | None = None, level: float = 0.95) -> FrequencyResponse:
    """Frequency response at the operating point u, by default from a decade below the slowest pole to Nyquist."""
    G = tangent(info.chain, info.theta, u)
    if w is None:
        w = _frequencies(G, info.Ts)
    w = np.asarray(w, dtype=float)
    if np.any(w <= 0) or np.any(w > np.pi / info.Ts * (1 + 1e-12)):
        raise InputError(f"frequencies must lie above 0 and up to Nyquist, {np.pi / info.Ts:g} rad/s")
    B, dB = _evaluate(G.B, G.B_gradient, w * info.Ts)
    F, dF = _evaluate(G.F, G.F_gradient, w * info.Ts)
    if np.any(B == 0) or not np.any(G.B):
        raise InputError(
            f"the tangent's gain is 0 at the operating point u = {u:.4g}; choose a u where the slopes of the maps are "
            'not zero, in fit.plot with at=, for example fit.plot(data, "bode", at=u)'
        )
    value = B / F
    return _in_parts(value, dB / B[:, None] - dF / F[:, None], lambda x, d: band(info, w, x, d, level))


@checked
def of_response_fit(result: ResponseFit, w: np.ndarray | None = None, level: float = 0.95) -> FrequencyResponse:
    """The model's frequency response after a fit to one, by default over the range of the data."""
    data, covariance = result.data, result.fit.covariance
    w = np.geomspace(data.w[0], data.w[-1], 300) if w is None else np.asarray(w, dtype=float)
    value, gradient = result.response(w)
    factor = normal_quantile(result, level)

    def band_of(x: np.ndarray, d: np.ndarray) -> Band:
        std = np.sqrt(np.maximum(np.sum((d @ covariance.cov) * d, axis=1), 0.0))
        return Band(w, x, std, x - factor * std, x + factor * std, level)

    return _in_parts(value, gradient / value[:, None], band_of)


def normal_quantile(result: ResponseFit, level: float) -> float:
    """Half widths of intervals in standard deviations: by Student where the errors themselves tell their size."""
    freedom = max(result.fit.criteria.N - result.fit.criteria.d, 1)
    known = result.data.std is not None and result.data.absolute
    return float(ndtri(0.5 + 0.5 * level) if known else stdtrit(freedom, 0.5 + 0.5 * level))


def _in_parts(
    value: np.ndarray, d_log: np.ndarray, band_of: Callable[[np.ndarray, np.ndarray], Band]
) -> FrequencyResponse:
    """Magnitude and phase of value (n,), complex, whose logarithm has the gradient d_log (n, P)."""
    size, angle = np.abs(value), np.degrees(np.unwrap(np.angle(value)))
    # A band of log |G| stays positive when it is transformed back.
    log = band_of(np.log(size), d_log.real)
    # A bound that far out bounds nothing, and in other units it is more than a number holds.
    with np.errstate(over="ignore"):
        low, high = np.exp(log.lower), np.where(log.upper < np.log(size) + _OPEN, np.exp(log.upper), np.inf)
    magnitude = Band(log.x, size, size * log.std, low, high, log.level, log.note)
    return FrequencyResponse(magnitude, band_of(angle, np.degrees(d_log.imag)))


def _evaluate(p: np.ndarray, dp: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Polynomial in q^-1 and its gradient at e^(j angle)."""
    powers = np.exp(-1j * np.outer(angle, np.arange(len(p))))
    return powers @ p, powers @ dp


def _response_band(info: Information, G: Rational, u: np.ndarray, level: float) -> Band:
    """B/F u with gradient: dy = (dB u - dF y) / F."""
    from scipy.signal import lfilter

    y = lfilter(G.B, G.F, u)
    by_b, by_f = lfilter([1.0], G.F, u), -lfilter([1.0], G.F, y)
    gradient = np.zeros((len(u), G.B_gradient.shape[1]))
    for signal, d in ((by_b, G.B_gradient), (by_f, G.F_gradient)):
        for k in range(min(len(d), len(u))):
            gradient[k:] += np.outer(signal[: len(u) - k], d[k])
    return band(info, np.arange(len(u)) * info.Ts, y, gradient, level)


def _length(G: Rational, samples: int | None) -> int:
    """Samples to show: six time constants of the slowest pole, between 20 and 2000."""
    if samples is not None:
        if samples < 2:
            raise InputError(f"samples is {samples}; give at least 2")
        return int(samples)
    r = np.abs(np.roots(G.F))
    slowest = float(r.max(initial=0.0))
    memory = -6.0 / np.log(slowest) if 0.0 < slowest < 1.0 else 0.0 if slowest <= 0.0 else 2000.0
    return int(np.clip(memory, 20, 2000))


def _frequencies(G: Rational, Ts: float) -> np.ndarray:
    z = np.roots(G.F).astype(complex)
    s = np.abs(np.log(z[np.abs(z) > 1e-6])) / Ts
    slow = float(s[s > 1e-6 / Ts].min(initial=0.1 / Ts))
    return np.geomspace(min(0.1 * slow, 0.01 * np.pi / Ts), np.pi / Ts, 400)
