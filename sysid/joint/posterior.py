"""A joint with all its parts at once: what the record does not show stays at what is usual.

Growth decides for each part whether a joint has it. A record seldom settles that, and a part that is left out is taken
for zero: friction at rest, for example, which every joint has. Here the most likely joint is found under the priors of
`sysid.joint.prior` (maximum a posteriori), with few starts. It is a model to predict with; its parts are no evidence.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.blocks import CoastingPlay, Compliance
from sysid.data.record import IOData
from sysid.estimation.fit import fit_chain
from sysid.estimation.initial_state import with_initial_states
from sysid.estimation.joint_parts import lift_theta, motor_of, shake_theta, sub
from sysid.estimation.noise_model import noise_model
from sysid.estimation.objective import Objective
from sysid.estimation.problem import ChainProblem
from sysid.estimation.result import Fit
from sysid.estimation.starts.staged_joint import play_starts
from sysid.joint.parts import SUBSTEPS, is_plain
from sysid.joint.prior import joint_prior, units_of, usual_values
from sysid.joint.rounds import best_points
from sysid.model.chain import Chain
from sysid.structures import actuated_joint

_POINTS, _LEADERS, _GLANCE = 24, 4, 6  # starts with parts, of which some go on after a few iterations
_LEVELS = 2  # times that the level of the noise is taken anew
_SHAKES = 12  # places near the optimum that are tried
_FIRST_LEVEL = 3.0  # of the noise in the first search, by the residuals of the plain joint
# Of backlash: widths by the way, bearings and weights by a way and second squared, and where the link hangs.
_WIDTHS, _BEARINGS, _HOLDS, _WEIGHT = (0.003, 0.009, 0.02), (2.0, 10.0, 50.0), (0.03, 0.15, 0.6), 70.0
_HANGS = (-0.5, 0.0, 0.25, 0.5, 0.75, 1.0, 1.5)


@checked(late=True)
def joint_posterior(
    data: IOData,
    plain: Chain | None = None,
    starts: int = 2,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Fit:
    """The most likely actuated joint with all parts, for `data` and the priors of `sysid.joint.prior`.

    `plain` is the joint without parts, as for `sysid.grow_joint`; `starts` are those of the plain joint. Raises
    InputError for another chain, and the errors of `sysid.fit`.
    """
    chain = actuated_joint(play=False) if plain is None else plain
    if not is_plain(chain):
        raise InputError("joint_posterior begins with a plain actuated_joint; leave Stribeck, loss, jam and play out")
    with one_blas_thread(), np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        plain_fit = fit_chain(chain.scaled(data.u, data.y), data, search="lm", starts=starts, seed=seed)
        rng = np.random.default_rng([seed, len(plain_fit.theta)])
        full = full_joint(plain_fit.model)
        units = units_of(plain_fit.model, plain_fit.theta, data)
        search = partial(fit_chain, full, data, search="lm", progress=progress)
        level = _FIRST_LEVEL * float(np.sqrt(plain_fit.criteria.mse))
        points = np.array(list(_starting_points(plain_fit, full, usual_values(full, units), data, rng)))
        for _ in range(_LEVELS):
            objective = Objective(curvature_weight=0.0, prior=joint_prior(full, units, level))
            leaders = best_points(full, points, data, _GLANCE, _LEADERS, objective)
            fit = search(start=leaders, objective=objective)
            level = _level(fit, data)
            shaken = [np.clip(shake_theta(full, fit.theta, rng), *full.limits) for _ in range(_SHAKES)]
            points = np.array([fit.theta, *shaken])
        return search(
            start=fit.theta[None], objective=Objective(curvature_weight=0.0, prior=joint_prior(full, units, level))
        )


def full_joint(plain: Chain) -> Chain:
    """A plain joint with every part: friction at rest by direction, loss, jam, and backlash of a link that coasts."""
    motor = motor_of(plain)
    full = replace(motor, stribeck=True, sided=True, loss=motor.loaded, jams=bool(motor.stops), substeps=SUBSTEPS)
    blocks = [full if block is motor else block for block in plain.blocks]
    if not any(isinstance(block, Compliance) for block in blocks):
        blocks.insert(len(blocks) - (blocks[-1].role == "sensor"), CoastingPlay(role="play"))
    fixed = {name: value for name, value in plain.fixed.items() if name != f"{motor.role}.load0" or not full.loss}
    return sub(replace(plain, fixed=fixed), tuple(blocks))


def _starting_points(
    plain: Fit, full: Chain, values: dict[str, tuple[float, float]], data: IOData, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """The plain joint with the usual values of the parts, then with drawn ones, and the backlashes that suit best."""
    new = {name: value for name, value in values.items() if name not in plain.model.names}
    low = dict(zip(full.names, full.limits[0], strict=True))
    centres = {name: centre for name, (centre, _) in new.items()}
    plays = _plays(plain, full, centres, data)
    for k in range(_POINTS):
        drawn = {name: centre + (k > 0) * spread * rng.standard_normal() for name, (centre, spread) in new.items()}
        drawn = {name: abs(value) if low[name] >= 0.0 else value for name, value in drawn.items()}
        yield lift_theta(plain.model, plain.theta, full, drawn | plays[k % len(plays)])


def _plays(plain: Fit, full: Chain, centres: dict[str, float], data: IOData) -> list[dict[str, float]]:
    """Backlashes for the starts, those first that explain most of what the joint without them leaves."""
    blocks = tuple(block for block in full.blocks if not isinstance(block, CoastingPlay))
    if len(blocks) == len(full.blocks):
        return [{}]
    middle = sub(full, blocks)
    theta = lift_theta(plain.model, plain.theta, middle, centres)
    return play_starts(full, middle, theta, data, partial(_links, data.Ts))[: _POINTS // 2]


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


def _level(fit: Fit, data: IOData) -> float:
    """The deviation of white noise that moves the parameters as far as the colour of the residuals does."""
    thetas = with_initial_states(fit.model, fit.theta, data)
    problem = ChainProblem(fit.model, thetas, data.experiments, fit.model.free)
    e, J = problem.linearise(problem.start)
    lengths = [int(part.observed.sum()) for part in data.experiments]
    return float(np.sqrt(noise_model(e, J, lengths).level(J, lengths)))
