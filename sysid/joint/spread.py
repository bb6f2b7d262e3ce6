"""How far a joint's value may be off: by noise, by what the model lacks, by the sensor and by an unseen backlash.

A model that lacks something of the joint comes to other values on other parts of the record, also where the curvature
at its optimum says that the record determines them closely. Fits to each half of the record show it: their deviation
from the fit to the whole estimates its standard deviation without that curvature (subsampling: Politis, Romano and
Wolf, Subsampling, Springer 1999, chapter 2).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from sysid.base.parallel import one_blas_thread
from sysid.data.record import IOData
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.noise_model import noise_model
from sysid.estimation.result import Fit
from sysid.joint.holdout import holdout_folds, refit
from sysid.uncertainty.information import Information, information

# Independent directions of what a joint's model lacks: friction, linkage and backlash repeat their errors with every
# movement, so their number does not grow with the record.
_DIRECTIONS = 10.0
# Standard uncertainty, as a share of the value, that every joint model leaves even where its residuals are white,
# because other parameters make up for what it lacks: found on drawn legs of the twin (the study drawn_joints). Those
# of voltages are shares of the friction, at rest for a break-away.
LACKS = {"coulomb": 0.025, "moving_friction": 0.025, "breakaway": 0.12, "backlash": 0.15}
LACKS |= {"speed_per_volt": 0.008, "dead": 0.12}  # a servo rests where its drive beyond the band is below a break-away
END_REACH = 0.01  # of the travel: how far an end may lie from the rests against it, which the backlash keeps apart
TIME_DEVIATION = 0.1  # of a sample: the same of a time
DELAY_SHARE = 0.1  # of a time: what else delays a joint, as a backlash that a model has not, looks like lag
_STEP = 1e-6
END_DEVIATION = (
    0.005  # of the travel: standard uncertainty of an end, by the side of the backlash on which the link rests
)


@dataclass(frozen=True)
class Spread:
    """Half widths of intervals at one level of values that are read from theta (P,); nan if undetermined.

    `noise`: information of coloured residuals. `lack`: standard deviation that the structure in the residuals leaves in
    a direction of theta, relative to that of the plain information `plain`. `refits`: theta (P,) of the fits to each
    half of the record.
    """

    noise: Information
    plain: Information
    lack: float
    level: float
    refits: tuple[np.ndarray, ...] = ()

    def __call__(self, read: Callable[[np.ndarray], float]) -> float:
        return self.noise.quantile(self.level) * self.std(read)

    def std(self, read: Callable[[np.ndarray], float]) -> float:
        """Standard uncertainty of a value; nan if it is undetermined.

        It is no smaller than the deviation of the value on each half of the record from that on the whole: with half of
        the information, their variances are the same.
        """
        gradient = gradient_of(read, self.noise.theta)
        structural = self.lack * float(np.linalg.norm(gradient @ self.plain.factor))
        at_optimum = float(np.hypot(float(self.noise.std_of(gradient)[0]), structural))
        return at_optimum if np.isnan(at_optimum) else max(at_optimum, self.apart(read))

    def apart(self, read: Callable[[np.ndarray], float]) -> float:
        """Root mean square deviation of a value on halves of the record from that on the whole; 0 without halves."""
        value = read(self.noise.theta)
        deviations = np.array([read(theta) - value for theta in self.refits])
        deviations = deviations[np.isfinite(deviations)]
        return float(np.sqrt(np.mean(deviations**2))) if len(deviations) else 0.0


def white_spread(fit: Fit, level: float) -> Callable[[Callable[[np.ndarray], float]], float]:
    """Half width of an interval of a value that is read from theta, for white residuals; nan if it is undetermined."""
    factor = float(norm.ppf(0.5 + level / 2))
    covariance, is_known = fit.covariance.cov, np.isfinite(fit.covariance.std()) | ~fit.model.free

    def spread(read: Callable[[np.ndarray], float]) -> float:
        gradient = gradient_of(read, fit.theta)
        if np.any(np.abs(gradient[~is_known]) > 0.0):
            return np.nan
        return factor * float(
            np.sqrt(max(gradient[is_known] @ covariance[np.ix_(is_known, is_known)] @ gradient[is_known], 0.0))
        )

    return spread


def spread_of(fit: Fit, data: IOData, level: float, halves: bool = True) -> Spread:
    """The spread of a fit to the record `data`.

    Structure that is left in the residuals is orthogonal to what the parameters can follow. What the model lacks has as
    much along the parameters as along any other of its `_DIRECTIONS`: with m the structure, |m|^2 = N (mean square of
    the residuals - variance of the noise), a value with gradient g is off by (g' (J'J)^-1 g |m|^2 / directions)^(1/2).
    The variance of the noise is that of the innovations of an autoregression. The halves are those of
    `sysid.joint.holdout.holdout_folds`; a record that is too short has none, and without `halves`
    they are not asked.
    """
    e, plain = residuals(fit, data), information(fit, data, lags=None)
    all_e = np.concatenate(e)
    mse, lengths = float(np.mean(all_e**2)), [len(part) for part in e]
    noise = noise_model(all_e, np.zeros((len(all_e), 0)), lengths).variance if mse > 0.0 else 0.0
    lack = np.sqrt(len(all_e) * max(1.0 - noise / mse, 0.0) / _DIRECTIONS) if mse > 0.0 else 0.0
    refits = tuple(_refit_fold(fit, fold.estimation) for fold in holdout_folds(data)) if halves else ()
    return Spread(information(fit, data, lags="auto"), plain, float(lack), level, refits)


def _refit_fold(fit: Fit, part: IOData) -> np.ndarray:
    with one_blas_thread(), np.errstate(all="ignore"):
        return refit(fit.model, fit.theta, part, fit.prior)


def structural_deviation(name: str, value: float, travel: float, Ts: float, dry: float) -> float:
    """Standard uncertainty of a value by what every model of a joint lacks; `travel` is the way between the ends.

    dry [V]: dry friction. The voltage that moves a joint is as uncertain as that, also where a load makes it small. Of
    a servo's dead band it is the error that asks for that drive.
    """
    if name.startswith("end_"):
        return END_DEVIATION * travel
    if name in ("lag_and_delay", "time_constant", "delay"):
        return float(np.hypot(TIME_DEVIATION * Ts, DELAY_SHARE * value))
    reference = dry if name.startswith(("coulomb", "moving_friction", "dead")) else abs(value)
    return next((share for start, share in LACKS.items() if name.startswith(start)), 0.0) * reference


def gradient_of(read: Callable[[np.ndarray], float], theta: np.ndarray) -> np.ndarray:
    """Central differences (P,) of a value that is read from theta."""
    out = np.zeros(len(theta))
    for i in range(len(theta)):
        step = np.zeros(len(theta))
        step[i] = _STEP * max(1.0, abs(theta[i])) if theta[i] == 0.0 else _STEP * abs(theta[i])
        out[i] = (read(theta + step) - read(theta - step)) / (2.0 * step[i])
    return out


def residuals(fit: Fit, data: IOData) -> list[np.ndarray]:
    """Residuals of the free run of each experiment, of its observed samples."""
    found = []
    for k, record in enumerate(data.experiments):
        theta = fit.theta if k == 0 else estimate_initial(fit.model, fit.theta, record)
        e = record.y[:, 0] - fit.model.simulate(theta, record.u[:, 0])
        found.append(e[record.observed[:, 0]])
    return found
