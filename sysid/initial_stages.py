"""Starts of a joint with more physics: a plainer joint is fitted first, and what it lacks starts from its optimum.

A cost over friction curves and plays has many valleys, and which one is right shows only where all else fits already.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sysid.blocks import CoastingPlay, Motor
from sysid.chain import Chain
from sysid.data import IOData
from sysid.initial_joint import joint_starts
from sysid.initial_state import with_initial_states
from sysid.iterate import Options, Outcome, iterate
from sysid.problem import ChainProblem
from sysid.searches import LevenbergMarquardt

_STEPS = Options(max_iterations=60, tolerance=0.01)
_JAM = 3.0  # samples that a motor stays jammed at first, which struck a stop at full speed
_TRIED = 4  # starts of the plainest joint
_WIDTH = 0.005  # of the range of y: the play that is tried
_DRAGS = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # widths a sample^2
_PULL = 8.0  # widths a sample^2 at half the range from where the link hangs
_HANGS = np.linspace(0.1, 0.9, 9)  # of the range of y
_HOLDS = (0.0, 0.1, 0.25, 0.45, 0.8)  # of half the range about there, within which the drag holds the link


def plainer(chain: Chain) -> Chain | None:
    """The chain without Stribeck's curve, without the screw's loss and without a play that coasts; None if it is so."""
    blocks = tuple(_plain(b) if isinstance(b, Motor) else b for b in _without_play(chain).blocks)
    return None if blocks == chain.blocks else _sub(chain, blocks)


def staged_starts(chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
    """`count` starting points theta (P,) of a joint whose `plainer` one exists."""
    record = max(data.experiments, key=lambda e: e.N)
    plain = plainer(chain)
    assert plain is not None
    found = _best(plain, joint_starts(plain, record, _TRIED, seed), data)
    middle = _without_play(chain)
    if middle != plain:
        found = _best(middle, [_lifted(plain, found, middle, more) for more in _frictions(plain, found, data)], data)
    if middle is chain:
        return [found]
    return [_lifted(middle, found, chain, more) for more in _plays(chain, middle, found, data)[:count]]


def _plain(motor: Motor) -> Motor:
    return replace(motor, stribeck=False, loss=False, jams=False, substeps=min(motor.substeps, 2))


def _without_play(chain: Chain) -> Chain:
    blocks = tuple(b for b in chain.blocks if not isinstance(b, CoastingPlay))
    return chain if len(blocks) == len(chain.blocks) else _sub(chain, blocks)


def _sub(chain: Chain, blocks: tuple) -> Chain:
    """A chain of fewer or plainer blocks, with what of `fixed` and `bounds` it still has."""
    names = Chain(blocks).names
    fixed = {name: value for name, value in chain.fixed.items() if name in names}
    for b in blocks:
        if isinstance(b, Motor) and b.load and not b.loss:
            fixed.setdefault(f"{b.role}.load0", 0.0)
    bounds = {name: limits for name, limits in chain.bounds.items() if name in names}
    return Chain(blocks, chain.structure, fixed, bounds)


def _lifted(chain: Chain, theta: np.ndarray, richer: Chain, more: dict[str, float]) -> np.ndarray:
    """theta of a richer chain: what both have, what the richer one holds, and `more`."""
    known = dict(zip(chain.names, theta, strict=True)) | more | dict(richer.fixed)
    out = np.array([known.get(name, 0.0) for name in richer.names])
    return np.clip(out, *richer.limits)


def _best(chain: Chain, points: list[np.ndarray], data: IOData) -> np.ndarray:
    outcomes: list[tuple[ChainProblem, Outcome]] = []
    for theta in points:
        problem = ChainProblem(chain, with_initial_states(chain, theta, data), tuple(data.experiments), chain.free)
        outcomes.append((problem, iterate(problem, problem.start, LevenbergMarquardt(), _STEPS)))
    problem, outcome = min(outcomes, key=lambda pair: pair[1].cost)
    return problem.thetas(outcome.p)[0]


def _frictions(plain: Chain, theta: np.ndarray, data: IOData) -> Iterator[dict[str, float]]:
    """What a motor's friction may have besides, by the parameters' names.

    Frictions that differ up and down may be a load, and a screw's loss that goes with it: the same at mid stroke.
    """
    motor = next(b for b in plain.blocks if isinstance(b, Motor))
    part = plain.part(theta, motor)
    gain, rise, fall = (motor.value(part, name) for name in ("gain", "rise", "fall"))
    mean, load = 0.5 * (rise + fall), 0.5 * (rise - fall)
    fastest = gain * max(float(np.abs(data.u).max()) - mean, 0.1 * mean)
    for creep in (0.1, 0.5):
        for loss, share in ((0.1, 0.0), (0.7, 0.0), (0.3, 1.0), (1.0, 1.0)):
            held = share * (rise - fall) / 2, loss * share * abs(load)
            values = {
                "stick": 0.2 * mean,
                "stick_speed": max(creep * gain * mean, 1e-8),
                "loss": loss,
                "jam": _JAM / fastest,
            }
            values |= {"rise": rise - held[0] - held[1], "fall": fall + held[0] - held[1], "load0": held[0]}
            yield {f"{motor.role}.{name}": value for name, value in values.items()}


def _plays(chain: Chain, middle: Chain, theta: np.ndarray, data: IOData) -> list[dict[str, float]]:
    """Parameters of the play by name, those first that promise to take most off the cost of `middle` at theta.

    What a play would add to the output is judged beside the model's own sensitivities, which would follow it, and its
    width by the share of it that the residuals ask for.
    """
    play = next(b for b in chain.blocks if isinstance(b, CoastingPlay))
    k = chain.blocks.index(play)
    thetas = with_initial_states(middle, theta, data)
    problem = ChainProblem(middle, thetas, tuple(data.experiments), middle.free)
    problem = replace(problem, theta0=problem.thetas(iterate(problem, problem.start, LevenbergMarquardt(), _STEPS).p))
    e, J = problem.linearise(problem.start)
    Q = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))[0]
    left = e - Q @ (Q.T @ e)
    shown = [_through(middle, row, r.u[:, 0], 0, k) for row, r in zip(problem.theta0, problem.records, strict=True)]
    plain = [_through(middle, row, x, k, None) for row, x in zip(problem.theta0, shown, strict=True)]
    low, high = min(x.min() for x in shown), max(x.max() for x in shown)
    ranked = []
    for part in _candidates(low, high):
        moved = []
        for row, x, y, r in zip(problem.theta0, shown, plain, problem.records, strict=True):
            z = play.propagate(np.array(part), x, np.empty((len(x), 0)), 0)
            change = _through(middle, row, z, k, None) - y
            moved.append(change if r.missing is None else change[r.observed[:, 0]])
        change = np.concatenate(moved)
        change -= Q @ (Q.T @ change)
        size = float(change @ change)
        share = float(np.clip(change @ left / size, 0.2, 5.0)) if size > 0.0 else 1.0
        ranked.append((float(np.sum((left - share * change) ** 2)), share, part))
    ranked.sort(key=lambda row: row[0])
    names = [f"{play.role}.{slot.name}" for slot in play.slots()]
    return [dict(zip(names, (share * part[0], *part[1:]), strict=True)) for _, share, part in ranked]


def _through(chain: Chain, theta: np.ndarray, x: np.ndarray, first: int, last: int | None) -> np.ndarray:
    """x (N,) through some of the chain's blocks."""
    for b in chain.blocks[first:last]:
        x = b.propagate(chain.part(theta, b), x, np.empty((len(x), 0)), 0)
    return x


def _candidates(low: float, high: float) -> Iterator[tuple[float, ...]]:
    """width, rest, drag, pull0, pull1 of plays: links that nothing pulls, and links that hang or stand somewhere."""
    width, half = _WIDTH * (high - low), 0.5 * (high - low)
    for drag in _DRAGS:
        yield width, 0.0, drag * width, 0.0, 0.0
    for share in _HANGS:
        for slope in (_PULL * width / half, -_PULL * width / half):
            for hold in _HOLDS:
                at = low + share * (high - low)
                yield width, 0.0, hold * half * abs(slope), -slope * at, slope
