"""Parameters of a static map that comes as near to a given curve as it can."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from sysid.block.block import StaticBlock
from sysid.blocks import PiecewiseLinear
from sysid.estimation.portfolio import hats

_TRIES = 3  # starts of a map with a shape of its own


@dataclass(frozen=True)
class Mapped:
    """theta (p,): curve(x) is about `behind` times the map at `before` x. The filters beside it take the gains."""

    theta: np.ndarray
    before: float = 1.0
    behind: float = 1.0


def as_block(block: StaticBlock, at: np.ndarray, values: np.ndarray, mass: np.ndarray) -> Mapped:
    """The map nearest to the curve `values` (k,) at the places `at` (k,), weighed by `mass` (k,)."""
    if isinstance(block, PiecewiseLinear) and block.free_knots:
        places = _apart(hats.fewer(at, values, mass, block.knots), block.knots)
        return Mapped(np.concatenate([places, np.interp(places, at, values)]))
    x = np.linspace(at[0], at[-1], 8 * len(at))
    y = np.interp(x, at, values)
    weight = np.sqrt(np.interp(x, at, mass) + 0.02 * mass.max())
    rising = float(np.sum(weight * (x - x.mean()) * (y - y.mean()))) >= 0.0
    best, best_cost = Mapped(block.start(x)), np.inf
    rng = np.random.default_rng(0)
    for turn in range(_TRIES):
        for sign in (1.0, -1.0) if turn == 0 else (1.0 if rising else -1.0,):
            found, cost = _nearest(block, x, y, weight, sign, rng if turn else None)
            if cost < best_cost:
                best, best_cost = found, cost
    return best


def _nearest(
    block: StaticBlock, x: np.ndarray, y: np.ndarray, weight: np.ndarray, sign: float, rng: np.random.Generator | None
) -> tuple[Mapped, float]:
    """One search over the map's parameters and the gains before and behind it."""
    gain = float(np.ptp(y) / (np.ptp(x) or 1.0)) or 1.0
    theta = block.start(x)
    if rng is not None:
        theta = block.vary(theta, rng)
    slots = block.slots()
    n = len(theta)
    low = np.array([s.lower for s in slots] + [-np.inf, -np.inf])
    high = np.array([s.upper for s in slots] + [np.inf, np.inf])

    def error(p: np.ndarray) -> np.ndarray:
        own = p[:n]
        if not block.admissible(own):
            own = block.repair(own)
        with np.errstate(over="ignore", invalid="ignore"):
            e = weight * (p[n + 1] * gain * block.output(own, p[n] * x) - y)
        return np.where(np.isfinite(e), e, 1e6 * (np.abs(y).max() + 1.0))

    first = np.clip(np.concatenate([theta, [1.0, sign]]), low + 1e-12, high - 1e-12)
    try:
        out = least_squares(error, first, bounds=(low, high), x_scale="jac", max_nfev=40)
    except (ValueError, np.linalg.LinAlgError):
        return Mapped(theta, 1.0, gain * sign), np.inf
    own = out.x[:n] if block.admissible(out.x[:n]) else block.repair(out.x[:n])
    return Mapped(own, float(out.x[n]), float(out.x[n + 1] * gain)), float(out.cost)


def _apart(places: np.ndarray, count: int) -> np.ndarray:
    """Exactly `count` places, the widest gaps halved, and none nearer to the next than a map admits."""
    found = list(places)
    while len(found) < count:
        k = int(np.argmax(np.diff(found)))
        found.insert(k + 1, 0.5 * (found[k] + found[k + 1]))
    at, gap = np.array(found), 0.011 * (found[-1] - found[0])
    for k in range(1, count):
        at[k] = max(at[k], at[k - 1] + gap)
    return at
