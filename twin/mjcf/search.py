"""The search for the largest posterior: tree by tree of bodies, then all together, with the noise that is left over."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from sysid.base.errors import InputError
from sysid.solver.iterate import Options
from twin.calibrate.search import Optimum, find_optimum
from twin.mjcf.logs import RobotLog
from twin.mjcf.parameters import parameters
from twin.mjcf.problem import STARTS, Fit
from twin.mjcf.robot import Robot, drives_of
from twin.mjcf.samples import without_spikes
from twin.mjcf.simulation import Rig

ROUNDS = 3  # searches, each with the noise that the last one left
SETTLED = 0.1  # change of the noise by which another search would bring nothing
OPENING, SHORTEST = 0.5, 20  # [s] and samples of a log that tell its start; a longer part tells the model's errors
QUIETEST = 1e-6  # [rad, m] noise of readings that never change
LEAST = 1.0 / 3.0  # of the noise that differences of the readings show: what is left over cannot be less

Report = Callable[[str], None]


def find_posterior(
    rig: Rig,
    logs: Sequence[RobotLog],
    rng: np.random.Generator,
    limits: Options,
    say: Report,
    place: np.ndarray | None = None,
) -> tuple[Fit, Optimum, int]:
    """The problem and its optimum, and how many runs it took; the search begins at `place` (n,) where it is known.

    The problem's logs are without the single readings that no joint makes.
    Trees of bodies that nothing connects are searched one after the other, as robots of their own, since a step that is
    good for one leg would be refused for another's sake. Raises InputError for logs over which the model cannot be
    simulated.
    """
    simulations = 0
    if place is None and (parts := _trees(rig.robot)) is not None:
        found = []
        for k, part in enumerate(parts):
            columns = [[drive.name for drive in rig.robot.drives].index(drive.name) for drive in part.drives]
            own = [log.part(drives=columns) for log in logs]
            kinds = list(dict.fromkeys(parameter.kind.name for parameter in rig.parameters))
            part_rig = Rig(part, parameters(part, kinds), rig.threads)
            task, optimum, count = _rounds(part_rig, own, None, rng, limits, _named(say, f"{k + 1} of {len(parts)}"))
            found.append((task, optimum.p))
            simulations += count
        place = _together(Fit(rig, logs, np.ones(len(rig.robot.drives))), found)
    task, optimum, count = _rounds(rig, logs, place, rng, limits, say)
    return task, optimum, simulations + count


def start_of(rig: Rig, values: np.ndarray, log: RobotLog, sigma: np.ndarray) -> np.ndarray:
    """The start (3, drives) of a log under known `values` (P,), from its first `OPENING` seconds."""
    n = max(round(OPENING / log.Ts), SHORTEST)
    task = Fit(rig, [log.part(rows=slice(n))], sigma, known=values)
    if task.residual(task.start) is None:
        return log.start
    return np.asarray(task.starts(find_optimum(task, np.random.default_rng(0), draws=0).p)[0])


def check_course(task: Fit, p: np.ndarray) -> None:
    """Raises InputError where the model cannot be simulated at p (n,)."""
    if task.residual(p) is None:
        raise InputError(
            f"{task.rig.robot.path}: over these logs the model cannot be simulated (its motion grows without limit); "
            "check its time step, and the units of the commands"
        )


def _named(say: Report, name: str) -> Report:
    """`say` with the name of a part before each text."""
    return lambda text: say(f"{name}, {text}")


def _rounds(
    rig: Rig, logs: Sequence[RobotLog], place: np.ndarray | None, rng: np.random.Generator, limits: Options, say: Report
) -> tuple[Fit, Optimum, int]:
    """Searches from `place` (n,), or from the model's own values; the noise of each is what the last one left over."""
    least = np.maximum(np.median([log.noise for log in logs], axis=0), QUIETEST)
    sigma, simulations, starts = least, 0, 24 if place is None else 0
    for k in range(ROUNDS):
        task = Fit(rig, logs, sigma, place)
        check_course(task, task.start)

        def tell(iteration: int, loss: float, k: int = k) -> None:
            say(f"search {k + 1}, iteration {iteration}")

        optimum = find_optimum(task, rng, draws=0 if k else starts, progress=tell, options=limits)
        simulations += task.simulations
        clean = [without_spikes(log, y, least) for log, y in zip(logs, task.readings(optimum.p), strict=True)]
        spikes = any(new is not old for new, old in zip(clean, logs, strict=True))
        residual = np.maximum(task.residual_sizes(optimum.p, clean), LEAST * least)
        if (np.allclose(residual, sigma, rtol=SETTLED) and not spikes) or optimum.late or k == ROUNDS - 1:
            break
        place, sigma, logs = optimum.p, residual, clean
    return task, optimum, simulations


def _trees(robot: Robot) -> list[Robot] | None:
    """The robot tree by tree, each without the bodies of the others; None where there is one, or where they touch."""
    trees = list(dict.fromkeys(drive.tree for drive in robot.drives))
    if len(trees) < 2 or robot.coupled:
        return None
    model, parts = robot.model, []
    roots = [int(model.dof_bodyid[np.flatnonzero(model.dof_treeid == tree)[0]]) for tree in range(model.ntree)]
    for tree in trees:
        names = [drive.name for drive in robot.drives if drive.tree == tree]
        try:
            spec = robot.stand.copy()
            for other in [body for body in spec.bodies if body.id in roots and body.id != roots[tree]]:
                spec.delete(other)
            part = spec.compile()
            parts.append(
                Robot(robot.path, spec, part, drives_of(robot.path, part, names), robot.notes, spec, robot.held)
            )
        except (ValueError, mujoco.FatalError):  # something else in the file names these bodies
            return None
    return parts


def _together(task: Fit, found: Sequence[tuple[Fit, np.ndarray]]) -> np.ndarray:
    """The point (n,) of all drives from those of the parts; a value that they share is their median."""
    names = [free.name for free in task.free]
    values: dict[tuple[str, int], list[float]] = {}
    for part, p in found:
        for free, z, order in zip(part.free, p, _order(part), strict=True):
            values.setdefault((free.name, order), []).append(float(z))
    pairs = zip(names, _order(task), task.start, strict=True)
    return np.array([np.median(values.get((name, order), [z])) for name, order, z in pairs])


def _order(task: Fit) -> list[int]:
    """For each parameter the log that it belongs to; -1 for those of all logs."""
    n = len(task.rig.robot.drives) * len(STARTS)
    return [-1] * len(task.shared) + [k for k in range(len(task.logs)) for _ in range(n)]
