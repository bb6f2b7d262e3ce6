"""Bands of what an evaluated model says beside its poles: static maps, step response, frequency response.

They follow from the fit and its estimation data, and allow for coloured residuals. Where the record gives no band, the
curves stand alone.
"""

from dataclasses import dataclass, replace
from weakref import ref

import numpy as np
from scipy.signal import lfilter

from sysid.base.errors import InputError
from sysid.base.poles import Motion
from sysid.blocks import Predictor
from sysid.estimation.result import Fit
from sysid.uncertainty import responses
from sysid.uncertainty.curves import OWN, Curve, curves
from sysid.uncertainty.information import Information, information
from sysid.uncertainty.intervals import Band
from sysid.uncertainty.responses import FrequencyResponse
from sysid.uncertainty.spectrum import Spectrum, noise_spectrum, spectrum
from sysid.workflow.results import Evaluation

LINEAR = ("armax", "arx", "bj", "output_error", "process")
_FINEST = 2048  # samples of a part: half as many frequencies, more than a picture shows
SEES_INPUT, GIVES_OUTPUT = ("input", "driver"), ("output", "map", "sensor")


@dataclass(frozen=True)
class Bands:
    """The maps in the order of the signal, the step response and the frequency response; None where there is none.

    `info` is the information of the record that they follow from. `spectrum` is the estimate without a model, and
    `noise` the power of what the free run leaves, with that of the model's noise (n,).
    """

    maps: tuple[Curve, ...]
    step: Band | None
    frequency: FrequencyResponse | None
    info: Information | None = None
    spectrum: Spectrum | None = None
    noise: tuple[Band, np.ndarray] | None = None


# The last evaluation asked for: the figures of one page ask one after another, and the sensitivities are large.
_last: list[tuple["ref[Evaluation]", Bands]] = []


def bands(evaluation: Evaluation) -> Bands:
    """The bands of an evaluation."""
    if _last and _last[0][0]() is evaluation:
        return _last[0][1]
    _last[:] = [(ref(evaluation), _compute_bands(evaluation))]
    return _last[0][1]


def _compute_bands(e: Evaluation) -> Bands:
    """The bands, from the information of the record where it has any."""
    maps = tuple(_curve_without_band(e, role) for role in e.maps)
    step = None if e.step is None else Band.bare(e.step.x, e.step.y)
    info = _information(e)
    estimate, noise = _spectra(e)
    if info is None:
        return Bands(maps, step, None, None, estimate, noise)
    middle = float(np.mean(e.estimation.u))
    try:
        known = {curve.role: curve for curve in curves(info)}
        maps = tuple(known.get(curve.role, curve) for curve in maps)
    except InputError:  # a signal between the blocks does not move
        pass
    if step is not None:
        # The curve stays that of the evaluation; the band is about it.
        wide = responses.step(info, middle, len(step.x))
        half = (wide.upper - wide.value, wide.value - wide.lower)
        step = replace(wide, x=step.x, value=step.value, upper=step.value + half[0], lower=step.value - half[1])
    try:
        frequency = responses.frequency(info, middle)
    except InputError:  # the tangent has no gain there
        frequency = None
    return Bands(maps, step, frequency, info, estimate, noise)


def _spectra(e: Evaluation) -> tuple[Spectrum | None, tuple[Band, np.ndarray] | None]:
    """The spectral estimate of the estimation data, and that of what a linear model's free run leaves of them."""
    fit, data = e.fit, e.estimation
    if not isinstance(fit, Fit) or fit.model.structure not in LINEAR or e.outputs:
        return None, None
    try:
        samples = _FINEST if max(data.lengths) > 12 * _FINEST else None
        estimate = spectrum(data, samples)
        v = data.y[:, 0] - np.ravel(e.estimation_output)
        if e.growing is not None or not np.all(np.isfinite(v)) or not np.any(v):
            return estimate, None
        noise = noise_spectrum(v, data, samples)
    except InputError:  # too short, with gaps, or an input that does not move
        return None, None
    z, block = np.exp(-1j * noise.x * data.Ts), fit.model.blocks[-1]
    if isinstance(block, Predictor):
        C, D = block.noise(fit.model.part(fit.theta, block))
        variance = fit.criteria.mse
    else:
        C, D = np.ones(1), np.append(1.0, -np.array((fit.noise or ((),))[0]))
        variance = float(np.mean(lfilter(D, C, v) ** 2))
    H = np.polyval(C[::-1], z) / np.polyval(D[::-1], z)
    return estimate, (noise, 2.0 * data.Ts * variance * np.abs(H) ** 2)


def _information(e: Evaluation) -> Information | None:
    """The information of the record on a model with a linear block; None if there is none."""
    if not isinstance(e.fit, Fit) or not e.linear or e.motion == Motion.UNSTABLE or e.roots is None:
        return None
    coloured = e.tests is not None and not e.tests.white
    try:
        return information(e.fit, e.estimation, lags="auto" if coloured else None)
    except InputError:
        return None


def _curve_without_band(e: Evaluation, role: str) -> Curve:
    u, y = e.estimation.u_unit, e.estimation.y_unit
    x_unit = u if role in SEES_INPUT else y if role == "sensor" else ""
    y_unit = y if role in GIVES_OUTPUT else u if role == "driver" else ""
    return Curve(role, Band.bare(e.maps[role].x, e.maps[role].y), OWN, x_unit, y_unit)
