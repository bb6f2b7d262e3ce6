"""The static maps of a fit with bands, each in a scale that the record determines.

Gain and offset can be shared freely between two blocks, so the values of a map are arbitrary there. A map with a fixed
scale (a saturation on the input has slope one) is shown unchanged. For every other map, the signals between blocks are
scaled to the mean and standard deviation of the outer signal over the record: the output of an input map has those of
u, the input of an output map has those of y, and a map between two linear blocks has signals with mean 0 and standard
deviation 1, of which the input follows u. These curves do not depend on the gauge, nor on a sign that moves from one
filter to another. A straight line on the diagonal means no nonlinearity.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from sysid.block.block import StaticBlock
from sysid.blocks.offset import is_offset
from sysid.data.record import IOData
from sysid.uncertainty.information import GAUGE, Information
from sysid.uncertainty.intervals import Band, band

OWN, NORMALISED = "own", "normalised"


@dataclass(frozen=True)
class Curve:
    """One static map: its band, and whether `scale` is the map's own or the normalised one.

    x_unit and y_unit are the units of the axes: the unit of u or y, or '' between two linear blocks.
    """

    role: str
    band: Band
    scale: str
    x_unit: str
    y_unit: str


@dataclass(frozen=True)
class _Signal:
    """A signal over the record: range, mean and deviation with gradients (P,)."""

    lower: float
    upper: float
    mean: float
    std: float
    d_mean: np.ndarray
    d_std: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, J: np.ndarray) -> "_Signal":
        mean, std = float(x.mean()), float(x.std())
        if std == 0.0:
            raise InputError("a signal between the blocks is constant over the record, so its map has no scale")
        d_mean = J.mean(axis=0)
        return cls(float(x.min()), float(x.max()), mean, std, d_mean, ((x - mean) @ (J - d_mean)) / (len(x) * std))


@dataclass(frozen=True)
class _Scale:
    """Shown value = mean + std * sign * (signal - signal.mean) / signal.std."""

    mean: float
    std: float
    sign: float


@checked
def curves(info: Information, points: int = 101, level: float = 0.95) -> tuple[Curve, ...]:
    """Every static map of the chain over its input range in the record."""
    return tuple(curve(info, role, points=points, level=level) for role in _roles(info))


@checked
def curve(info: Information, role: str, x: np.ndarray | None = None, points: int = 101, level: float = 0.95) -> Curve:
    """The static map with this role over x (n,), by default `points` over its input range in the record.

    x is in the scale of the curve, see `Curve`. The first of merged experiments that moves gives the scale.
    """
    if role not in _roles(info):
        raise unknown("static map", role, _roles(info))
    k = next(i for i, b in enumerate(info.chain.blocks) if b.role == role)
    signals, correlation, follows = _signals(info, k)
    own_x = np.linspace(signals[0].lower, signals[0].upper, points) if x is None else np.asarray(x, dtype=float)
    raw = band(info, own_x, *_raw(info, k, own_x), level)
    u_unit, y_unit = info.data.u_unit, info.data.y_unit
    first, last = k == 0, _is_last(info, k)
    units = (u_unit if first else y_unit if last else "", y_unit if last else u_unit if first else "")
    if raw.note != GAUGE:
        return Curve(role, raw, OWN, units[0] if first else "", units[1] if last else "")
    scales = _scales(info, first, last, 1.0 if correlation >= 0 else -1.0, follows)
    return Curve(role, _normalised_band(info, k, signals, scales, x, points, level), NORMALISED, *units)


def _roles(info: Information) -> list[str]:
    return [b.role for b in info.chain.blocks if isinstance(b, StaticBlock) and b.n_parameters and not is_offset(b)]


def _is_last(info: Information, k: int) -> bool:
    return all(map(is_offset, info.chain.blocks[k + 1 :]))


def _scaling(data: IOData) -> IOData:
    """The first experiment in which the input moves; the first if none."""
    return next((e for e in data.experiments if np.ptp(e.u) > 0.0), data.experiments[0])


def _signals(info: Information, k: int) -> tuple[tuple[_Signal, _Signal], float, float]:
    """Input and output of block k over the experiment that scales them, the covariance of the two, and the sign with
    which the input follows u: that of their largest covariance at any delay."""
    record, chain, theta = _scaling(info.data), info.chain, info.theta
    x, J, q = np.ascontiguousarray(record.u[:, 0]), np.zeros((record.N, len(theta))), 0
    map_input = x, J.copy()
    for b in chain.blocks[: k + 1]:
        map_input = x, J.copy()
        x = b.propagate(chain.part(theta, b), x, J, q)
        q += b.n_parameters
    centred, u = map_input[0] - map_input[0].mean(), record.u[:, 0] - record.u[:, 0].mean()
    delayed = correlate(centred, u)[record.N - 1 :]
    follows = -1.0 if delayed[np.argmax(np.abs(delayed))] < 0.0 else 1.0
    return (_Signal.of(*map_input), _Signal.of(x, J)), float(centred @ (x - x.mean())), follows


def _scales(
    info: Information, first: bool, last: bool, sign: float, follows: float
) -> tuple[_Scale | None, _Scale | None]:
    """Scaling of the two sides of a map; None where the side is u or y itself. The sign makes maps increase.

    Between two filters a map that is turned by half a turn increases too, hence `follows`.
    """
    record = _scaling(info.data)
    u, y = record.u[:, 0], record.y[record.observed[:, 0], 0]
    if first and last:
        return None, None
    if first:
        return None, _Scale(float(u.mean()), float(u.std()), sign)
    if last:
        return _Scale(float(y.mean()), float(y.std()), sign), None
    return _Scale(0.0, 1.0, follows), _Scale(0.0, 1.0, follows * sign)


def _raw(info: Information, k: int, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The map at fixed x (n,) in its own scale, with its gradient (n, P); the last one with the offset behind it."""
    y, gradient = np.ascontiguousarray(x), np.zeros((len(x), len(info.theta)))
    for block in info.chain.blocks[k:] if _is_last(info, k) else info.chain.blocks[k : k + 1]:
        y = block.propagate(info.chain.part(info.theta, block), y, gradient, info.chain.index(block).start)
    return y, gradient


def _normalised_band(
    info: Information,
    k: int,
    signals: tuple[_Signal, _Signal],
    scales: tuple[_Scale | None, _Scale | None],
    shown_x: np.ndarray | None,
    points: int,
    level: float,
) -> Band:
    """The map between signals in `scales`; the gradient includes the dependence of the scales on theta."""
    (input_signal, out), (x_scale, y_scale), block = signals, scales, info.chain.blocks[k]
    if shown_x is None:
        ends = np.array([input_signal.lower, input_signal.upper])
        if x_scale is not None:
            ends = np.sort(x_scale.mean + x_scale.std * x_scale.sign * (ends - input_signal.mean) / input_signal.std)
        shown_x = np.linspace(ends[0], ends[1], points)
    shown_x = np.asarray(shown_x, dtype=float)
    x, J = shown_x, np.zeros((len(shown_x), len(info.theta)))
    if x_scale is not None:
        r = x_scale.sign * (shown_x - x_scale.mean) / x_scale.std
        x, J = input_signal.mean + r * input_signal.std, input_signal.d_mean + r[:, None] * input_signal.d_std
    P = J.shape[1]
    wide = np.concatenate([J, np.zeros((len(x), block.n_parameters))], axis=1)
    y = block.propagate(info.chain.part(info.theta, block), np.ascontiguousarray(x), wide, P)
    gradient = wide[:, :P].copy()
    gradient[:, info.chain.index(block)] += wide[:, P:]
    if y_scale is not None:
        r = (y - out.mean) / out.std
        gradient = y_scale.sign * y_scale.std * (gradient - out.d_mean - r[:, None] * out.d_std) / out.std
        y = y_scale.mean + y_scale.sign * y_scale.std * r
    return band(info, shown_x, y, gradient, level)
