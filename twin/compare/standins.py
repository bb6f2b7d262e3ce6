"""Stand-ins for a leg with one effect off nominal: drawn joint, size and excitation, with all noise."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.compare.effects import END_HIGH, END_LOW, TABLE, apply_knobs
from twin.experiment import Experiment
from twin.follow import VISIBLE, Follower
from twin.hardware.linkage import end_angles, middle
from twin.log import Log
from twin.parameters import JOINTS, Parameters

# The weight of the thigh holds its link on one side of the backlash, and gravity does not load the shoulder's vertical
# axis: on this stand no record shows these two.
INVISIBLE = (("thigh", "backlash"), ("shoulder", "load"))
NOTHING = "nothing"
DURATION, TS = 30.0, 0.05
_EXCITATIONS: tuple[tuple[str, dict[str, float]], ...] = (("aprbs", {}), ("sweep", {"jitter": 0.5, "shrink": 0.4}))


@dataclass(frozen=True)
class StandIn:
    """A log of a leg that departs from the nominal twin by one `effect`; `size` says what was drawn."""

    effect: str
    joint: str
    excitation: str
    size: str
    log: Log


def stand_in(effect: str, seed: int) -> StandIn:
    """The stand-in number `seed` of this effect, one of `TABLE` or "nothing"."""
    rng = np.random.default_rng([seed, [*TABLE, NOTHING].index(effect)])
    while True:  # a departure that nobody sees is drawn again
        joint = str(rng.choice([name for name in JOINTS if (name, effect) not in INVISIBLE]))
        excitation, options = _EXCITATIONS[int(rng.integers(len(_EXCITATIONS)))]
        p = Parameters()
        experiment = Experiment(joint, excitation, DURATION, TS, seed=seed, options=options)
        plan = Log(experiment.commands()[:, 0], np.full(experiment.N, middle(p, joint)), TS, joint=joint)
        departure, slope, size = (p, 1.0, "") if effect == NOTHING else _DRAWS[effect](p, joint, plan.u, rng)
        follower = Follower(plan, joint, threads=1)
        if effect == NOTHING or _visible(follower, p, departure, slope):
            break
    log = follower.record(departure, seed=seed)
    return StandIn(effect, joint, excitation, size, Log(log.u, slope * log.y, TS, None, joint, {"source": "stand-in"}))


def _visible(follower: Follower, p: Parameters, departure: Parameters, slope: float) -> bool:
    nominal, response = follower.readings([p, departure])
    return float(np.sqrt(np.mean((slope * response - nominal) ** 2))) >= VISIBLE


Draw = Callable[[Parameters, str, np.ndarray, np.random.Generator], tuple[Parameters, float, str]]


def _friction(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """Coulomb friction times 0.5 to 0.87 or 1.15 to 2; or its difference between directions, by 0.15 to 0.4."""
    if rng.random() < 0.3:
        change = float(rng.choice([-1, 1]) * rng.uniform(0.15, 0.4))
        return p.replace({f"{joint}.asymmetry": p[f"{joint}.asymmetry"] + change}), 1.0, f"asymmetry {change:+.2f}"
    factor = float(np.exp(rng.choice([-1, 1]) * rng.uniform(np.log(1.15), np.log(2.0))))
    return p.replace({f"{joint}.coulomb": factor * p[f"{joint}.coulomb"]}), 1.0, f"Coulomb friction times {factor:.2f}"


def _backlash(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """0.5 to 3 degrees more."""
    increase = float(np.exp(rng.uniform(np.log(0.5), np.log(3.0))))
    name = f"{joint}.backlash"
    return p.replace({name: p[name] + np.deg2rad(increase)}), 1.0, f"backlash {increase:+.2f} deg"


def _delay(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """10 to 150 ms more, in whole periods of the board; or the 20 ms of the twin less."""
    if rng.random() < 0.15:
        return p.replace({"delay": 0.0}), 1.0, f"delay {-1e3 * p['delay']:.0f} ms"
    increase = 0.01 * round(float(np.exp(rng.uniform(0.0, np.log(15.0)))))
    return p.replace({"delay": p["delay"] + increase}), 1.0, f"delay {1e3 * increase:+.0f} ms"


def _end_stop(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """One end or both, 0.5 to 6 degrees further in."""
    inward = np.exp(rng.uniform(np.log(0.5), np.log(6.0), 2)) * np.array([(1, 0), (0, 1), (1, 1)][rng.integers(3)])
    low, high = end_angles(p, joint)
    ends = {END_LOW: low + np.deg2rad(inward[0]), END_HIGH: high - np.deg2rad(inward[1])}
    return apply_knobs(p, joint, ends), 1.0, f"ends {inward[0]:.2f} and {inward[1]:.2f} deg further in"


def _load(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """0.1 to 1.5 kg more at the foot."""
    increase = float(np.exp(rng.uniform(np.log(0.1), np.log(1.5))))
    return p.replace({"foot_mass": p["foot_mass"] + increase}), 1.0, f"{increase:.2f} kg at the foot"


def _supply(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """The motor gets 75 to 97 % of every voltage; or at most 65 to 95 % of the largest; or 2 to 8 Ohm in the supply."""
    kind = rng.integers(3)
    if kind == 0:
        share = float(rng.uniform(0.75, 0.97))
        name = f"{joint}.rated_voltage"
        return p.replace({name: p[name] / share}), 1.0, f"{100 * share:.0f} % of every voltage"
    if kind == 1:
        volts = float(rng.uniform(0.65, 0.95) * np.abs(u).max())
        return p.replace({"supply_voltage": volts}), 1.0, f"a supply of {volts:.1f} V"
    ohm = float(rng.uniform(2.0, 8.0))
    return p.replace({"supply_resistance": ohm}), 1.0, f"{ohm:.1f} Ohm in the supply"


def _speed(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """No-load speed 3 to 15 % lower or higher, at the same stall force."""
    factor = float(np.exp(rng.choice([-1, 1]) * rng.uniform(np.log(1.03), np.log(1.15))))
    name = f"{joint}.no_load_speed"
    return p.replace({name: factor * p[name]}), 1.0, f"no-load speed times {factor:.2f}"


def _sensor(p: Parameters, joint: str, u: np.ndarray, rng: np.random.Generator) -> tuple[Parameters, float, str]:
    """Readings 1 to 8 % too large or too small."""
    slope = float(np.exp(rng.choice([-1, 1]) * rng.uniform(np.log(1.01), np.log(1.08))))
    return p, slope, f"readings times {slope:.3f}"


_DRAWS: dict[str, Draw] = {
    "friction": _friction,
    "backlash": _backlash,
    "delay": _delay,
    "end_stop": _end_stop,
    "load": _load,
    "supply": _supply,
    "speed": _speed,
    "sensor": _sensor,
}
