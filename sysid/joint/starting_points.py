"""Where the search of a joint with all parts begins: drawn parts, and the backlashes that suit best."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from sysid.blocks import CoastingPlay, Play
from sysid.data.record import IOData
from sysid.estimation.initial_state import estimate_initial
from sysid.estimation.joint_parts import lift_theta, shake_theta, sub
from sysid.estimation.result import Fit
from sysid.estimation.starts.staged_joint import play_starts
from sysid.joint.prior import KNOWN
from sysid.model.chain import Chain
from sysid.uncertainty.information import information

_POINTS = 24
_DRAWN = 150  # backlashes, by what is usual
_MOST = 8  # backlashes of either kind that are tried
_STEPS = 9  # over what is usual of a parameter
_SHAKES = 12  # places near an optimum
_FAR = 3.0  # deviations of the posterior that a draw goes, per direction
# Of backlash: widths by the way, bearings and weights by a way and second squared, and where the link hangs.
_WIDTHS, _BEARINGS, _HOLDS, _WEIGHT = (0.003, 0.009, 0.02), (0.3, 2.0, 10.0, 50.0), (0.03, 0.15, 0.6), 70.0
_HANGS = (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5)


def starting_points(
    plain: Fit, full: Chain, values: dict[str, tuple[float, float]], data: IOData, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """The plain joint as it is, with usual parts, and with drawn parts and the backlashes that suit best."""
    new = {name: value for name, value in values.items() if name not in plain.model.names}
    low = dict(zip(full.names, full.limits[0], strict=True))
    centres = {name: centre for name, (centre, _) in new.items()}
    plays = plays_of(full, lift_theta(plain.model, plain.theta, full, centres), data, rng)
    yield lift_theta(plain.model, plain.theta, full, {})
    for k in range(_POINTS - 1):
        drawn = {name: centre + (k > 0) * spread * rng.standard_normal() for name, (centre, spread) in new.items()}
        drawn = {name: abs(value) if low[name] >= 0.0 else value for name, value in drawn.items()}
        yield lift_theta(plain.model, plain.theta, full, drawn | plays[k % len(plays)])


def places_around(fit: Fit, data: IOData, level: float, rng: np.random.Generator) -> list[np.ndarray]:
    """Places (P,) around a fit to `data`: half with each value shaken, half drawn along what it hardly tells apart.

    Lag and delay, or a load and frictions that differ by direction, change together without a change of the output: a
    step of one of them alone leads back to the same optimum. `level` [y] of the noise: `sysid.joint.full.colour_level`.
    """
    info = information(fit, data, lags=None)
    root = _symmetric_root(info.factor[info.own]) * level / np.sqrt(info.noise_variance)
    places = [shake_theta(fit.model, fit.theta, rng) for _ in range(_SHAKES // 2)]
    places += [fit.theta + _FAR * (root @ rng.standard_normal(root.shape[1])) for _ in range(_SHAKES // 2)]
    return [np.clip(place, *fit.model.limits) for place in places]


def steps_from(
    chain: Chain, theta: np.ndarray, values: dict[str, tuple[float, float]], data: IOData
) -> list[np.ndarray]:
    """Places (P,) one parameter of a part from theta, the best first: what a jam or a play does has no slope at zero.

    Each is the best of `_STEPS` over what is usual, by the free run alone.
    """
    part = max(data.experiments, key=lambda experiment: experiment.N)
    begins, seen, found = estimate_initial(chain, theta, part), part.observed[:, 0], []
    for name, (centre, spread) in values.items():
        k = chain.names.index(name)
        places = np.clip(
            np.linspace(centre - 2.0 * spread, centre + 2.0 * spread, _STEPS), *np.array(chain.limits)[:, k]
        )
        trials = np.tile(begins, (_STEPS, 1))
        trials[:, k] = places
        errors = np.array([np.sum((part.y[:, 0] - chain.simulate(trial, part.u))[seen] ** 2) for trial in trials])
        best = int(np.argmin(np.nan_to_num(errors, nan=np.inf)))
        found.append((errors[best], np.where(np.arange(len(theta)) == k, places[best], theta)))
    return [place for _, place in sorted(found, key=lambda pair: pair[0])[:_MOST]]


def _symmetric_root(factor: np.ndarray) -> np.ndarray:
    """R (P, P) with R R' = factor factor', symmetric in correlations: a factor (P, n) has signs and axes by chance."""
    cov = factor @ factor.T
    std = np.sqrt(np.diag(cov))
    size = np.where(std > 0.0, std, 1.0)
    values, axes = np.linalg.eigh(cov / np.outer(size, size))
    return std[:, None] * ((axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T)


def plays_of(full: Chain, theta: np.ndarray, data: IOData, rng: np.random.Generator) -> list[dict[str, float]]:
    """Backlashes for the starts, those first that explain most of what the joint without them leaves."""
    blocks = tuple(block for block in full.blocks if not isinstance(block, Play | CoastingPlay))
    if len(blocks) == len(full.blocks):
        return [{}]
    middle = sub(full, blocks)
    coasts = any(isinstance(block, CoastingPlay) for block in full.blocks)
    kinds = (partial(_links, data.Ts), partial(_drawn_links, data.Ts, rng)) if coasts else (None,)
    theta, found = lift_theta(full, theta, middle, {}), list[dict[str, float]]()
    for links in kinds:
        pulls = dict[tuple[float, float], dict[str, float]]()
        for play in play_starts(full, middle, theta, data, links):  # the best of each weight: a wrong one hides it
            pulls.setdefault((play.get("play.pull0", 0.0), play.get("play.pull1", 0.0)), play)
        found += list(pulls.values())[:_MOST]
    return found


def _links(Ts: float, low: float, high: float) -> Iterator[tuple[float, ...]]:
    """width, rest, drag, pull0, pull1 of links without weight, and of links that hang or stand."""
    way, weight = high - low, _WEIGHT * Ts**2
    for width in _WIDTHS:
        for bearing in _BEARINGS:
            yield width * way, 0.0, bearing * Ts**2 * way, 0.0, 0.0
        for hang in (low + share * way for share in _HANGS):
            for slope in (weight, -weight):
                for hold in _HOLDS:
                    yield width * way, 0.0, hold * weight * way, -slope * hang, slope


def _drawn_links(Ts: float, rng: np.random.Generator, low: float, high: float) -> Iterator[tuple[float, ...]]:
    """The same of links drawn from what is usual, in balance somewhere on the way."""
    way, known = high - low, KNOWN[CoastingPlay]
    units = np.array([way, way * Ts**2, way * Ts**2, Ts**2])
    spreads = units * [known[name].spread for name in ("width", "drag", "pull0", "pull1")]
    for width, drag, pull0, pull1 in spreads * rng.standard_normal((_DRAWN, 4)):
        yield abs(width), 0.0, abs(drag), pull0 - pull1 * rng.uniform(low, high), pull1
