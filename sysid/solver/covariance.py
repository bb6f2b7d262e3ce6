"""Covariance of a fit, and the parameters that the data do not determine."""

from dataclasses import dataclass

import numpy as np

from sysid.solver.linearisation import Linearisation, column_scale

_CANCELS = 1e-7  # share of what its parts vary that is left of a value whose parts cancel, but for rounding
_RCOND = 1e-7  # singular value, of the largest, below which a direction is not determined


@dataclass(frozen=True)
class Covariance:
    """cov (P, P) over all parameters (zero rows for fixed ones) and which are not identifiable from the data (P,).

    The gauge is removed: redundant directions have no variance. Quantities that do not depend on the gauge (poles,
    zeros, curves between fixed ends) are correct, and single gains refer to the gauge with the smallest norm.

    at_bound (P,) marks parameters that the fit would move on but for a bound, for example those of an integrator, whose
    pole would leave the unit circle. The covariance is that of what stays at the bound: a value that cannot move there
    has no variance and no interval either. None in a file of an earlier version.
    """

    cov: np.ndarray
    unidentifiable: np.ndarray
    noise_variance: float
    at_bound: np.ndarray | None = None

    def std(self) -> np.ndarray:
        """Standard deviation of each parameter (P,); nan where the data do not determine it, and at a bound."""
        s = np.sqrt(np.maximum(np.diag(self.cov), 0.0))
        return np.where(self.unidentifiable | (self.bounded & (s == 0.0)), np.nan, s)

    @property
    def bounded(self) -> np.ndarray:
        """`at_bound` (P,), or nowhere if that is unknown."""
        return np.zeros(len(self.cov), dtype=bool) if self.at_bound is None else self.at_bound

    def deviation(self, gradient: np.ndarray) -> float:
        """Standard deviation of a value with this gradient (P,); nan where it is at a bound."""
        with np.errstate(invalid="ignore", over="ignore"):  # fewer samples than parameters: the variance is infinite
            std = float(np.sqrt(max(float(gradient @ self.cov @ gradient), 0.0)))
            spread = np.sqrt(np.maximum(np.diag(self.cov), 0.0))
            at_limit = np.any(self.bounded & (gradient != 0.0)) and cancels(gradient, np.array(std), spread)
        return np.nan if at_limit else std


def covariance(lin: Linearisation, gauge: np.ndarray, basis: np.ndarray, d: int) -> Covariance:
    """sigma^2 (J'J)^+ for residuals e (N,) and J (N, n) = dyhat/dp of `lin`, theta = theta0 + basis (P, n) p.

    gauge (n, g) holds the redundant directions of p and d the number of parameters counted. Columns of J are first
    scaled to unit norm, so that units do not decide what counts as zero (Ljung, System Identification, section 9.4;
    the pseudo-inverse is the covariance in the gauge with the smallest norm).
    """
    P = len(basis)
    sigma2 = lin.cost / max(lin.N - d, 1)
    R = lin.R  # its columns have the norms of J's
    if not R.shape[1]:
        return Covariance(np.zeros((P, P)), np.zeros(P, dtype=bool), sigma2)
    scale = column_scale(R)
    if not np.all(np.isfinite(R)):  # sensitivities beyond what a number holds: nothing is known of any parameter
        return Covariance(np.zeros((P, P)), np.ones(P, dtype=bool), sigma2)
    _, s, Vt = np.linalg.svd(R / scale)
    keep = s > _RCOND * s[0] if s[0] > 0 else np.zeros(len(s), dtype=bool)
    V = basis @ (Vt.T[:, keep] / s[keep] / scale[:, None])
    unidentifiable = _unidentifiable(Vt.T[:, ~keep], gauge * np.where(np.isfinite(scale), scale, 1.0)[:, None])
    return Covariance(sigma2 * (V @ V.T), np.abs(basis) @ unidentifiable > 0, sigma2)


def rank(lin: Linearisation) -> int:
    """Number of directions that J determines, by the rule of `covariance`."""
    R = lin.R
    if not R.shape[1] or not np.all(np.isfinite(R)):
        return 0
    s = np.linalg.svd(R / column_scale(R), compute_uv=False)
    return int(np.sum(s > _RCOND * s[0])) if s[0] > 0 else 0


def effective_count(data: Linearisation, full: Linearisation) -> float:
    """Effective number of parameters, trace of (J'J + W'W)^+ J'J: `full` has the rows W of a prior beside those of J.

    A parameter that the data determine counts 1, one that the prior holds 0 (MacKay 1992, Neural Computation 4,
    equation 3.12).
    """
    scale = column_scale(full.R)
    _, s, Vt = np.linalg.svd(full.R / scale)
    keep = s > _RCOND * s[0]
    return float(np.sum(((data.R / scale) @ (Vt.T[:, keep] / s[keep])) ** 2))


def _unidentifiable(null: np.ndarray, gauge: np.ndarray) -> np.ndarray:
    """Parameters (P,) with a component in directions, other than the gauge, that the data do not determine."""
    if gauge.shape[1]:
        Q = np.linalg.qr(gauge)[0]
        null = null - Q @ (Q.T @ null)
    return np.linalg.norm(null, axis=1) > 1e-2


def cancels(gradient: np.ndarray, std: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """True (m,) where a value with this gradient (m, P) has no deviation `std` (m,) because its parts cancel.

    spread (P,) are the deviations of the parameters, 0 of one at a bound. Of an integrator, the coefficients may vary
    and the pole at 1 may not.
    """
    return np.asarray(std <= _CANCELS * (np.abs(gradient) @ spread))


def pole_std(f: np.ndarray, cov_f: np.ndarray, held: bool = False) -> np.ndarray:
    """Standard deviation of the roots of F (nf,) from the covariance of f (nf, nf): sqrt(var Re + var Im).

    From F(z) = 0: dz/df_j = -z^(n-j) / F'(z). Nan at a multiple pole, where the first derivative does not exist, and
    where a bound has `held` a pole that has then no deviation.
    """
    n = len(f)
    F = np.concatenate([[1.0], f])
    slope = np.polyder(F)
    out, spread = [], np.sqrt(np.maximum(np.diag(cov_f), 0.0))
    for z in np.roots(F).astype(complex):
        d = np.polyval(slope, z)
        if abs(d) < 1e-12:
            out.append(np.nan)
            continue
        g = -np.array([z ** (n - j) for j in range(1, n + 1)]) / d
        with np.errstate(invalid="ignore", over="ignore"):  # fewer samples than parameters: the variance is infinite
            variance = float(np.real(np.conj(g) @ cov_f @ g))
        std = float(np.sqrt(max(variance, 0.0)))
        out.append(np.nan if held and cancels(np.abs(g), np.array(std), spread) else std)
    return np.array(out)
