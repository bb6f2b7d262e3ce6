"""Parts of a joint: for each, the chain with it and the starting points of its search, and the chain without it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.base.errors import InputError
from sysid.block.block import Block
from sysid.blocks import CoastingPlay, Motor, Play, TravelMap
from sysid.data.record import IOData
from sysid.data.wraps import DEGREES
from sysid.estimation.fit import fit_chain
from sysid.estimation.joint_parts import FRICTIONS, friction_starts, lift_theta, motor_of, sub
from sysid.estimation.result import Fit
from sysid.estimation.starts.staged_joint import play_starts
from sysid.model.chain import Chain
from sysid.solver.iterate import Options

_PLAYS_TRIED = 3  # of the plays that promise most, how many are tried
TURNS_NEEDED = (0.25, 20.0)  # turns of a record that may show such a load
SUBSTEPS = 4  # of a sample, for a curve of friction that changes within it
# Of the speed that friction in motion takes, which friction at rest keeps at the least. What falls within a part of a
# sample makes derivatives that grow without limit, and no record shows it.
_CREEP = 0.02
Candidate = tuple[Chain, np.ndarray]
_PRUNING_SEARCH = Options(max_iterations=20)


@dataclass(frozen=True)
class Part:
    """A part by name: what it is in words, and how a fit gets it.

    `options` are the fields of the motor that it sets; `play` is the block that it adds; `waves` are the harmonics of
    a load that repeats every turn.
    """

    words: str
    options: tuple[str, ...] = ()
    play: type[Block] | None = None
    waves: int = 0

    def added(self, fit: Fit, data: IOData) -> Candidate | None:
        """The chain with this part and starting points (K, P); None if the chain has it or cannot have it."""
        if self.waves:
            return _with_waves(fit, data, self.waves)
        return _with_friction(fit, data, self.options) if self.play is None else _with_play(fit, data, self.play)

    def within(self, other: "Part") -> bool:
        """Whether the other part contains this one."""
        return set(self.options) < set(other.options) or (self.play, other.play) == (Play, CoastingPlay)


# A self-locking screw has load-dependent friction and jams; one of the two alone may not lower BIC.
PARTS: dict[str, Part] = {
    "stribeck": Part("Stribeck friction (it falls with speed)", ("stribeck",)),
    "sticks": Part("Stribeck friction by direction (it falls with speed)", ("stribeck", "sided")),
    "sided": Part("friction at rest that differs by direction", ("sided",)),
    "loss": Part("screw friction proportional to its load", ("loss",)),
    "jams": Part("jamming at struck stops", ("jams",)),
    "screw": Part("screw friction proportional to its load, and jamming at the end stops", ("loss", "jams")),
    "plays": Part("a play", play=Play),
    "coasts": Part("backlash with a coasting link", play=CoastingPlay),
    "sags": Part("a supply that sags under the motor's current", ("sags",)),
    "turns": Part("a load that repeats every turn", waves=1),
}


def is_plain(chain: Chain) -> bool:
    """Whether the chain has a motor and none of the parts that can be added."""
    motors = [b for b in chain.blocks if isinstance(b, Motor)]
    richer = any(getattr(b, option, False) for b in motors for option in FRICTIONS)
    return bool(motors) and not richer and not any(isinstance(b, Play | CoastingPlay) for b in chain.blocks)


def chains_with_another(fit: Fit, data: IOData, names: tuple[str, ...]) -> Iterator[tuple[str, Chain, np.ndarray]]:
    """Every chain with one more part than the fit, with starting points (K, P)."""
    for name in names:
        candidate = PARTS[name].added(fit, data)
        if candidate is not None:
            yield name, *candidate


def restart_points(name: str, fit: Fit, data: IOData) -> list[np.ndarray]:
    """First values of a part that the fit has, beside its other values."""
    options = PARTS[name].options
    if not options:
        return []
    return [
        lift_theta(fit.model, fit.theta, fit.model, p) for p in friction_starts(options, fit.model, fit.theta, data)
    ]


def _with_friction(fit: Fit, data: IOData, options: tuple[str, ...]) -> Candidate | None:
    chain, motor = fit.model, motor_of(fit.model)
    if any(getattr(motor, option, True) or not _is_possible(motor, option, options) for option in options):
        return None
    motor_options: dict[str, Any] = dict.fromkeys(options, True)
    if "stribeck" in options:
        motor_options["substeps"] = max(motor.substeps, SUBSTEPS)
    richer = replace(motor, **motor_options)
    fixed_values = dict(chain.fixed)
    if "loss" in options and fixed_values.get(f"{motor.role}.load0") == 0.0:
        del fixed_values[f"{motor.role}.load0"]  # a loss tells a load from a difference between the frictions
    richer_chain = sub(replace(chain, fixed=fixed_values), tuple(richer if b is motor else b for b in chain.blocks))
    points = friction_starts(options, chain, fit.theta, data)
    if "stribeck" in options:
        part = chain.part(fit.theta, motor)
        gain, rise, fall = (motor.value(part, name) for name in ("gain", "rise", "fall"))
        least = max(_CREEP * gain * 0.5 * (rise + fall), 1e-9)
        richer_chain = replace(
            richer_chain, bounds={**richer_chain.bounds, f"{motor.role}.stick_speed": (least, np.inf)}
        )
    return richer_chain, np.array([lift_theta(chain, fit.theta, richer_chain, point) for point in points])


def _is_possible(motor: Motor, option: str, options: tuple[str, ...]) -> bool:
    needs: dict[str, Callable[[Motor], bool]] = {
        "loss": lambda m: bool(m.load or m.periodic),
        "jams": lambda m: bool(m.stops),
        "sided": lambda m: m.stribeck or "stribeck" in options,
    }
    return needs[option](motor) if option in needs else True


def _with_waves(fit: Fit, data: IOData, waves: int) -> Candidate | None:
    """A load periodic in the angle, of a motor whose position is the angle itself."""
    chain, motor = fit.model, motor_of(fit.model)
    period = 360.0 if data.y_unit in DEGREES else 2.0 * np.pi
    least, largest = (share * period for share in TURNS_NEEDED)
    mapped = any(isinstance(b, TravelMap) for b in chain.blocks)
    if mapped or motor.periodic or not least < np.ptp(data.y) < largest:
        return None
    richer = replace(motor, periodic=waves, period=period)
    richer_chain = sub(chain, tuple(richer if b is motor else b for b in chain.blocks))
    part = chain.part(fit.theta, motor)
    dry = 0.5 * (motor.value(part, "rise") + motor.value(part, "fall"))
    size = max(dry, 0.1 * float(np.std(data.u)))
    no_polynomial = {f"{motor.role}.load{i}": 0.0 for i in range(1, motor.load)}
    points = [
        {**no_polynomial, f"{motor.role}.sine1": share * size * a, f"{motor.role}.cosine1": share * size * b}
        for share in (0.5, 2.0)
        for a, b in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
    ]
    return richer_chain, np.array([lift_theta(chain, fit.theta, richer_chain, point) for point in points])


def _with_play(fit: Fit, data: IOData, kind: type[Block]) -> Candidate | None:
    """Backlash before the sensor, if there is one. A link that coasts may take the place of a play."""
    chain = fit.model
    present_kinds = CoastingPlay if kind is CoastingPlay else Play | CoastingPlay
    if any(isinstance(b, present_kinds) for b in chain.blocks):
        return None
    playless = sub(chain, tuple(b for b in chain.blocks if not isinstance(b, Play)))
    place = len(playless.blocks) - (playless.blocks[-1].role == "sensor")
    richer_chain = sub(playless, (*playless.blocks[:place], kind(role="play"), *playless.blocks[place:]))
    base = lift_theta(chain, fit.theta, playless, {})
    with np.errstate(all="ignore"):  # of a joint that does not move no link can be judged
        points_found = play_starts(richer_chain, playless, base, data)[:_PLAYS_TRIED]
    points = np.array([lift_theta(chain, fit.theta, richer_chain, point) for point in points_found])
    return (richer_chain, points) if np.all(np.isfinite(points)) else None


def remaining_parts(kept: tuple[str, ...], dropped: tuple[str, ...]) -> tuple[str, ...]:
    """The parts kept without those dropped; of a part that is made of two the other one stays."""
    parts = []
    for name in kept:
        options = PARTS[name].options
        if name in dropped or (options and set(options) <= set(dropped)):
            continue
        options_left = [option for option in options if option not in dropped]
        parts += [name] if len(options_left) == len(options) else options_left
    return tuple(parts)


def prune(
    fit: Fit, data: IOData, kept: tuple[str, ...], margin: float, options: dict[str, Any]
) -> tuple[Fit, tuple[str, ...]]:
    """The fit without every part whose loss raises BIC by `margin` or less, and the names of these parts.

    Nearly nothing of a joint's error in free run may depend on a part, and yet its value decides the next record: a
    jam at a stop that no turn of this record falls into, for example.
    """
    dropped: tuple[str, ...] = ()
    while True:
        fewer = {}
        for name in remaining_parts(kept, dropped):
            for single, (chain, points) in chains_without(name, fit):
                try:
                    fewer[single] = fit_chain(chain, data, start=points, options=_PRUNING_SEARCH, **options)
                except (InputError, np.linalg.LinAlgError):
                    continue
        best = min(fewer, key=lambda name: fewer[name].criteria.bic, default=None)
        if best is None or fewer[best].criteria.bic > fit.criteria.bic + margin:
            return fit, dropped
        fit, dropped = fewer[best], (*dropped, best)


def chains_without(name: str, fit: Fit) -> Iterator[tuple[str, Candidate]]:
    """The chain without a part and starting points (K, P), or one of each where the part is made of two."""
    part, chain, motor = PARTS[name], fit.model, motor_of(fit.model)
    if part.play is not None:
        yield name, _candidate(fit, tuple(b for b in chain.blocks if not isinstance(b, Play | CoastingPlay)), [{}])
    for option in part.options:
        if option == "stribeck" and motor.sided:  # which goes first
            continue
        motor_options: dict[str, Any] = {option: False} | ({"substeps": 1} if option == "stribeck" else {})
        plainer = replace(motor, **motor_options)
        blocks = tuple(plainer if b is motor else b for b in chain.blocks)
        yield option, _candidate(fit, blocks, _compensating_values(option, fit))


def _candidate(fit: Fit, blocks: tuple[Block, ...], points: list[dict[str, float]]) -> Candidate:
    plainer = sub(fit.model, blocks)
    return plainer, np.array([lift_theta(fit.model, fit.theta, plainer, point) for point in points])


def _compensating_values(option: str, fit: Fit) -> list[dict[str, float]]:
    """What the other parameters may be without this one: the friction at mid stroke stays."""
    motor = motor_of(fit.model)
    p = {**motor.absent, **motor.by_name(fit.model.part(fit.theta, motor))}
    if option == "loss":
        load_friction, load = p["loss"] * abs(p["load0"]), p["load0"]
        dry = {"rise": p["rise"] + load_friction + load, "fall": p["fall"] + load_friction - load, "load0": 0.0}
        return [{f"{motor.role}.{name}": value for name, value in dry.items()}]
    if option == "sided":
        return [
            {f"{motor.role}.stick": p["stick"] + share * (p["stick_down"] - p["stick"])} for share in (0.2, 0.5, 0.8)
        ]
    if option == "stribeck":
        shares = (0.0, 0.3)
        return [{f"{motor.role}.{way}": p[way] + share * p["stick"] for way in ("rise", "fall")} for share in shares]
    return [{}]
