"""Poles that a zero cancels within the accuracy of the record, so that no bounded interval can be given for them."""

import numpy as np
from scipy.signal import lfilter
from scipy.special import chdtri, fdtri

from sysid.blocks import TransferFunction
from sysid.model.tangents import transfer
from sysid.uncertainty.information import Information

CANCELLED = "is cancelled by a zero within the accuracy of the record, so the record determines neither of the two"
_ZERO = 1e-9  # modulus of a pole that is a delay
_RESPONSE = 300  # samples of the impulse response that give the size of a filter


def cancelled(info: Information, block: TransferFunction, z: complex, level: float) -> bool:
    """Whether the residue of the filter at its pole z may be zero.

    The record shows a pole only through its residue. Where this may be zero, any value of the pole fits, and an
    interval of finite length would hold the true one with no probability that can be stated (Fieller 1954, J. R. Stat.
    Soc. B 16; Gleser and Hwang 1987, Annals of Statistics 15). The residue is taken relative to the filter's impulse
    response, which makes it independent of the gauge. The pole is free where the residue is zero, so the quantile has
    twice as many degrees of freedom as the residue.
    """
    own = transfer(info.chain, info.theta, block)
    b, db = own.B[block.nk : block.nk + block.nb], own.B_gradient[block.nk : block.nk + block.nb]
    if largest := float(np.abs(b).max(initial=0.0)):  # the answer has no unit, and squares of a tiny gain are no number
        b, db = b / largest, db / largest
    F, dF = own.F[: block.nf + 1], own.F_gradient[: block.nf + 1]
    size, d_size = _size(b, db, F, dF)
    slope = complex(np.polyval(np.polyder(F), z))
    if size == 0.0 or slope == 0.0 or abs(z) <= _ZERO:
        return False
    past = z ** -np.arange(len(b), dtype=float)
    dz = -(z ** np.arange(len(F) - 1, -1, -1)) @ dF / slope
    # B(z) / F'(z), B in powers of 1/z and F in powers of z
    top, d_top = past @ b, past @ db - (np.arange(len(b)) * past / z) @ b * dz
    d_slope = (np.arange(len(F) - 1, 0, -1) * z ** np.arange(len(F) - 2, -1, -1)) @ dF[:-1]
    d_slope = d_slope + np.polyval(np.polyder(F, 2), z) * dz
    residue = top / slope
    d = (d_top - residue * d_slope) / slope / size - residue * d_size / size**2
    n = 1 if z.imag == 0.0 else 2
    value, parts = np.array([residue.real, residue.imag])[:n] / size, np.array([d.real, d.imag])[:n]
    cov = info.covariance_of(parts)
    if info.note_of(parts) or np.trace(cov) <= 1e-24 * float(value @ value):
        return False
    distance = float(value @ np.linalg.pinv(cov, rcond=1e-12, hermitian=True) @ value)
    m = 2.0 * n
    return distance < (m * fdtri(m, info.dof, level) if np.isfinite(info.dof) else chdtri(m, 1.0 - level))


def _size(b: np.ndarray, db: np.ndarray, F: np.ndarray, dF: np.ndarray) -> tuple[float, np.ndarray]:
    """Norm of the first samples of the impulse response, with its gradient (P,)."""
    one = np.eye(1, _RESPONSE)[0]
    h = lfilter(b, F, one)
    by_b, by_f = lfilter([1.0], F, one), -lfilter([1.0], F, h)
    size = float(np.linalg.norm(h))
    if size == 0.0 or not np.isfinite(size):
        return 0.0, np.zeros(db.shape[1])
    along = [float(h[k:] @ by_b[: _RESPONSE - k]) for k in range(len(b))]
    against = [float(h[k:] @ by_f[: _RESPONSE - k]) for k in range(len(F))]
    return size, (np.array(along) @ db + np.array(against) @ dF) / size
