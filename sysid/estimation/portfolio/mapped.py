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
    """One search over the map's parameters, the gains before and behind it, and an offset that others must take."""
    gain = float(np.ptp(y) / (np.ptp(x) or 1.0)) or 1.0
    theta = block.start(x)
    if rng is not None:
        theta = block.vary(theta, rng)
    slots, n = block.slots(), len(theta)
    low = np.array([s.lower for s in slots] + [-np.inf] * 3)
    high = np.array([s.upper for s in slots] + [np.inf] * 3)
    # What the map can do by itself stays as it is.
    own = block.symmetries(theta)
    turned = np.array(
        [
            not any(s.in_scale for s in own),  # alone, or together with the output's: then the gain behind is enough
            not any(s.out_scale and not s.in_scale for s in own),
            not any(s.out_shift and not s.in_shift for s in own),
        ]
    )
    moving = np.concatenate([np.ones(n, dtype=bool), turned])
    first = np.concatenate([theta, [1.0, sign * gain if turned[1] else 1.0, 0.0]])
    first = np.clip(first, low + 1e-12, high - 1e-12)

    def whole(p: np.ndarray) -> np.ndarray:
        full = first.copy()
        full[moving] = p
        if not block.admissible(full[:n]):
            full[:n] = block.repair(full[:n])
        return full

    def error(p: np.ndarray) -> np.ndarray:
        full = whole(p)
        with np.errstate(over="ignore", invalid="ignore"):
            e = weight * (full[n + 1] * block.output(full[:n], full[n] * x) + full[n + 2] - y)
        return np.where(np.isfinite(e), e, 1e6 * (np.abs(y).max() + 1.0))

    try:
        with np.errstate(all="ignore"):  # values near the limits of numbers end the search, they do not warn
            out = least_squares(error, first[moving], bounds=(low[moving], high[moving]), x_scale="jac", max_nfev=60)
    except (ValueError, np.linalg.LinAlgError):
        return Mapped(theta, 1.0, gain * sign), np.inf
    full = whole(out.x)
    return Mapped(full[:n], float(full[n]), float(full[n + 1])), float(out.cost)


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
