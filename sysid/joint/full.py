"""The joint with every part that it may have, and one search of it from the plain joint and the usual values."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.base.parallel import one_blas_thread
from sysid.blocks import CoastingPlay, Compliance, Linkage, Motor, Play, ServoMotor
from sysid.data.record import IOData
from sysid.data.wraps import turn_of
from sysid.estimation.fit import fit_chain
from sysid.estimation.initial_state import estimate_initial, with_initial_states
from sysid.estimation.joint_parts import FRICTIONS, lift_theta, motor_of, sub
from sysid.estimation.noise_model import noise_model
from sysid.estimation.objective import Objective
from sysid.estimation.problem import ChainProblem
from sysid.estimation.result import Fit
from sysid.estimation.search import SearchContext, set_curvature_weight
from sysid.joint.physics import travel_of
from sysid.joint.prior import BENDS, LOOSE, joint_objective, units_of, usual_values
from sysid.joint.sampling import ENOUGH_SAMPLES
from sysid.model.chain import Chain
from sysid.motor_parts import TABLE
from sysid.solver.iterate import Options
from sysid.solver.linearisation import order_of

PARTS = ("stribeck", "sided", "loss", "jams", "plays", "coasts", "sags", "bands", "turns", "levers", "bends")
TURNS_NEEDED = (0.25, 20.0)  # turns of a record that may show a load that repeats every turn
_GLANCE = 2  # iterations at each starting point, after which half of them go on
_CLEAR = np.log(20.0)  # of a likelihood over another: strong odds (Kass and Raftery, J. Amer. Statist. Assoc. 90, 1995)
SUBSTEPS = 4  # of a sample, for a curve of friction that changes within it


def is_plain(chain: Chain) -> bool:
    """Whether the chain has a motor and none of the parts of a full joint."""
    motors = [b for b in chain.blocks if isinstance(b, Motor)]
    richer = any(getattr(b, option, False) for b in motors for option in FRICTIONS if option != "sags")
    return bool(motors) and not richer and not any(isinstance(b, Play | CoastingPlay) for b in chain.blocks)


def full_joint(plain: Chain, data: IOData | None = None, parts: Iterable[str] = PARTS) -> Chain:
    """A plain joint with every one of these `PARTS` that it can have.

    "stribeck": more friction at rest than in motion, "sided": by direction; "loss": friction proportional to the load;
    "jams": at a struck stop; "plays": backlash, "coasts": of a link with inertia and weight; "sags": the supply of a
    servo; "bands": a dead band of its loop; "turns": a load that repeats every turn of a joint without linkage whose
    `data` go over `TURNS_NEEDED`; "levers": the load and the friction of a bearing by the slope of the `Linkage`,
    "bends": what that is off a triangle; and those of `sysid.motor_parts`.
    """
    motor, wanted = motor_of(plain), set(parts)
    options: dict[str, Any] = {name: name in wanted for name in ("stribeck", "sided")}
    options["further"] = tuple(name for name in TABLE if name in wanted or name in motor.further)
    options["jams"] = "jams" in wanted and bool(motor.stops)
    options["substeps"] = max(motor.substeps, SUBSTEPS if options["stribeck"] or options["further"] else 1)
    if isinstance(motor, ServoMotor):
        options["sags"] = motor.sags or "sags" in wanted
        options["dead"] = motor.dead or "bands" in wanted
    if data is not None and "turns" in wanted and _may_turn(plain, data):
        options |= {"periodic": 1, "period": turn_of(data) / _stroke(plain)}
    full = replace(motor, **options)
    full = replace(full, loss="loss" in wanted and full.loaded)
    if "levers" in wanted and isinstance(travel_of(plain), Linkage) and full.load and full.stops is True:
        full = replace(full, lever=True, load=4)
    blocks = [full if block is motor else block for block in plain.blocks]
    if "bends" in wanted and full.stops is True:  # else the stroke is that of the record
        blocks = [replace(b, bends=BENDS) if isinstance(b, Linkage) else b for b in blocks]
    if wanted & {"plays", "coasts"} and not any(isinstance(block, Compliance) for block in blocks):
        play = CoastingPlay(role="play") if "coasts" in wanted else Play(role="play")
        blocks.insert(len(blocks) - (blocks[-1].role == "sensor"), play)
    told = {f"{motor.role}.v0"}  # a part of a log begins in motion
    if full.loss:  # tells a load from a difference between the frictions
        told.add(f"{motor.role}.load0")
    fixed = {name: value for name, value in plain.fixed.items() if name not in told or value != 0.0}
    return sub(replace(plain, fixed=fixed), tuple(blocks))


def loose_linkage(chain: Chain) -> Chain:
    """The joint with a linkage that may be far from a triangle: a cam, four bars; itself if it has no bends."""
    blocks = [replace(b, bends=LOOSE) if isinstance(b, Linkage) and b.bends else b for b in chain.blocks]
    return sub(chain, tuple(blocks))


def at_rest(chain: Chain) -> Chain:
    """The joint with a motor that stands at the first sample, as in a record that is cut where it rests."""
    return replace(chain, fixed={**chain.fixed, f"{motor_of(chain).role}.v0": 0.0})


def _may_turn(chain: Chain, data: IOData) -> bool:
    """Whether a load may repeat every turn of the joint, and the record is long enough to show it."""
    if motor_of(chain).periodic or not _stroke(chain):
        return False
    least, largest = (share * turn_of(data) for share in TURNS_NEEDED)
    return bool(least < np.ptp(data.y) < largest)


def _stroke(chain: Chain) -> float:
    """Length [y] of the motor's unit of place: 1 without a linkage, the way of a straight one that is held, else 0."""
    travel = travel_of(chain)
    if travel is None:
        return 1.0
    ends = [chain.fixed.get(f"{travel.role}.{end}", np.nan) for end in ("low", "high")]
    return float(np.nan_to_num(abs(ends[1] - ends[0]))) if travel.is_line else 0.0


def with_turns(plain: Fit, data: IOData, cut: IOData, limit: Options, options: dict[str, Any]) -> Fit:
    """The plain joint with a load that repeats every turn in place of the other one, where that lowers BIC."""
    chain = full_joint(plain.model, data, ("turns",))
    motor = motor_of(plain.model)
    if chain == plain.model:
        return plain
    part = plain.model.part(plain.theta, motor)
    dry = 0.5 * (motor.value(part, "rise") + motor.value(part, "fall"))
    size, free = max(dry, 0.1 * float(np.std(data.u))), {f"{motor.role}.load{i}": 0.0 for i in range(1, motor.load)}
    waves = [
        free | {f"{motor.role}.{wave}1": share * size * way}
        for share in (0.5, 2.0)
        for wave in ("sine", "cosine")
        for way in (1.0, -1.0)
    ]
    points = np.array([lift_theta(plain.model, plain.theta, chain, wave) for wave in waves])
    try:
        found = fit_chain(chain, cut, start=points, options=limit, **options)
    except (InputError, np.linalg.LinAlgError):
        return plain
    return found if found.criteria.bic < plain.criteria.bic else plain


def rough_posterior(
    plain: Fit, whole: IOData, data: IOData, level: float, limit: Options, options: dict[str, Any]
) -> Fit:
    """The joint with every part from the usual values alone, for noise of deviation `level` [y].

    `data` are stretches of the record `whole`, which begin at rest.
    """
    full, units = at_rest(full_joint(plain.model, whole)), units_of(plain.model, plain.theta, whole)
    centres = {name: c for name, (c, _) in usual_values(full, units).items() if name not in plain.model.names}
    point = lift_theta(plain.model, plain.theta, full, centres)
    objective = joint_objective(full, units, level)
    return fit_chain(full, data, start=point[None], options=limit, objective=objective, **options)


def best_points(chain: Chain, points: np.ndarray, data: IOData, finalists: int, objective: Objective) -> np.ndarray:
    """The best of these points (K, P), the best first: after each few iterations the better half goes on.

    While many are left, a part of a long record tells them apart: half of it for twice as many points.
    """
    share = 1.0
    while len(points) * share > 2 * finalists:
        share /= 2.0
    part, running = None, list[tuple[ChainProblem, np.ndarray]]()
    while True:
        before, part = part, data.portion(max(ENOUGH_SAMPLES, round(share * data.N)))
        glance = Options.from_estimate(_GLANCE, Options().tolerance).begun()
        context = SearchContext(chain, part, objective, "lm", glance, None)
        if part is not before:
            problems = [context.problem(with_initial_states(chain, p, part)) for p in points]
            running = [(problem, problem.start) for problem in set_curvature_weight(context, problems)]
        ends = [(problem, context.iterate(problem, p, context.options)) for problem, p in running]
        ends = [end for end in ends if np.isfinite(end[1].cost)]
        ends = [ends[k] for k in order_of(end.cost for _, end in ends)]
        last = len(points) <= 2 * finalists
        ends = ends[: finalists if last else len(points) // 2]
        points = np.array([problem.thetas(end.p)[0] for problem, end in ends])
        if last or not len(points):
            return points
        running = [(problem, end.p) for problem, end in ends]
        share *= 2.0


def colour_level(fit: Fit, data: IOData) -> float:
    """The deviation of white noise that moves the parameters as far as the colour of the residuals does.

    However coloured, n samples tell no less than one does, so it is at most sqrt(n) times that of the residuals.
    """
    e, J = linearised(fit, data)
    lengths = [int(part.observed.sum()) for part in data.experiments]
    level = float(np.sqrt(noise_model(e, J, lengths).level(J, lengths)))
    return min(level, float(np.linalg.norm(e)))


def linearised(fit: Fit, data: IOData) -> tuple[np.ndarray, np.ndarray]:
    """Errors (N,) of a fit's free run over `data`, and their derivatives (N, n): first by the free parameters."""
    others = (estimate_initial(fit.model, fit.theta, part) for part in data.experiments[1:])
    problem = ChainProblem(fit.model, np.array([fit.theta, *others]), data.experiments, fit.model.free)
    return problem.linearise(problem.start)


def searched_from(fit: Fit, others: Iterable[Fit], data: IOData) -> Fit:
    """The joint `fit` to `data`, or a clearly likelier one to which `others`, of other records of this joint, lead.

    Pulses near break-away start the joint or do not, so the likelihood of their record has many tops, and a search may
    end on one far from where another record has led.
    """
    starts = [estimate_initial(fit.model, lift_theta(o.model, o.theta, fit.model, {}), data) for o in others]
    if not starts:
        return fit
    with one_blas_thread(), np.errstate(all="ignore"):  # another record's joint may run away on this one
        objective = Objective(curvature_weight=0.0, prior=fit.prior)
        found = fit_chain(fit.model, data, start=np.array([fit.theta, *starts]), objective=objective, search="lm")
    gain = 0.5 * data.N * np.log(fit.criteria.mse / found.criteria.mse)
    return found if gain > _CLEAR else fit
