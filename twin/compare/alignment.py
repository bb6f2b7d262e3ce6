"""How a log is read beside the twin: its delay, signs, slope and zero, each with an interval."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import unknown
from sysid.base.quantities import estimate
from twin.compare.departure import noise_of
from twin.compare.effects import DELAY, READ, SLOPE, START, ZERO
from twin.compare.intervals import Value, by_name, values
from twin.compare.search import Search, Trials, best_of, refine
from twin.compare.verdict import Verdict
from twin.follow import Follower
from twin.log import Log
from twin.parameters import Parameters

# What `--align` names, and the knob of each.
PARTS = {"delay": DELAY, "gear": SLOPE, "offset": ZERO, "sign": "sign"}
# The twin is never quite the leg. These move with the alignment and are not reported; each is expected within this many
# of its typical changes (`twin.compare.effects`) of the twin's value.
_BESIDE = ("JOINT.rated_voltage", "JOINT.coulomb", "JOINT.asymmetry", "JOINT.backlash", "foot_mass")
EXPECTED = 1.5
# These do not, and the twin has most of them as assumptions: they widen the intervals by a doubt of this share.
_DOUBTED = (
    "JOINT.stribeck",
    "JOINT.stribeck_speed",
    "JOINT.load_friction",
    "JOINT.rotor_inertia",
    "supply_resistance",
    "dead_band",
)
DOUBT = 0.3
_NEUTRAL = {"gear": 1.0}
_ROUNDS = 10
_TURNED = 0.6  # a sign counts as wrong if turning it leaves less than this share of the error
_ALIKE = 1.3  # two signs whose errors differ by less than this factor cannot be told apart
SIGNS = {(1, 1): "", (-1, 1): "input", (1, -1): "output", (-1, -1): "input and output"}


@dataclass(frozen=True)
class Alignment:
    """log angle(t) = gear twin angle(t - delay) + offset, after its signs are turned back.

    `turned`: "" or the signals with the opposite sign, "input", "output", "input and output", or "input or output" if
    the record cannot tell which. delay [s] comes on top of the twin's own; offset [rad]; start [rad] is the angle of
    the twin's drive at the first sample. `applied` names the parts that the comparison uses, of `PARTS`.
    """

    turned: str
    delay: Value
    gear: Value
    offset: Value
    start: Value
    applied: tuple[str, ...] = ()

    @property
    def read(self) -> dict[str, float]:
        """Nominal values of the knobs that are applied."""
        part_values = {"delay": self.delay, "gear": self.gear, "offset": self.offset}
        return {PARTS[part]: part_values[part].value for part in self.applied if part in part_values}

    def sentences(self) -> list[str]:
        """What was found, in words."""
        lines = []
        if self.turned:
            remark = "it was turned back" if "sign" in self.applied else "--align sign turns it back"
            lines.append(f"The {self.turned} of the log has the opposite sign: {remark}.")
        shift = f"{1e3 * abs(self.delay.value):.1f} ms {'later' if self.delay.value >= 0 else 'earlier'}"
        lines.append(
            f"Beside the twin the log comes {shift} ({_span(self.delay, 1e3, 'ms')}); "
            f"its angle is {self.gear.value:.4f} times the twin's ({_span(self.gear, 1.0, '')}) plus "
            f"{np.degrees(self.offset.value):.2f} deg ({_span(self.offset, 180 / np.pi, 'deg')})."
        )
        found = [part for part in ("delay", "gear", "offset") if self._differs(part)]
        if self.applied:
            lines.append(f"Applied: {', '.join(self.applied)}.")
        elif found:
            lines.append(f"Nothing of this is applied; --align {','.join(found)} would.")
        else:
            lines.append("None of the three differs beyond its interval, so nothing is to be applied.")
        return lines

    def _differs(self, part: str) -> bool:
        """Whether the interval of a part excludes what the twin has."""
        value: Value = getattr(self, part)
        return value.low is not None and not value.holds(_NEUTRAL.get(part, 0.0))


def _span(value: Value, factor: float, unit: str) -> str:
    if value.low is None or value.high is None:
        return "not determined by this record"
    _, low, high = estimate(*(factor * x for x in (value.value, value.low, value.high)))
    return f"95 %: {low} to {high}{' ' + unit if unit else ''}"


def parts(names: Iterable[str]) -> tuple[str, ...]:
    """The parts of an alignment to apply; raises InputError for one that does not exist."""
    selection = tuple(dict.fromkeys(names))
    for name in selection:
        if name not in PARTS:
            raise unknown("part of an alignment", name, PARTS)
    return selection


def opposite_signs(log: Log, joint: str, parameters: Parameters, **follower: object) -> str:
    """Which signals of the log have the opposite sign, of `SIGNS`; the twin is driven with every combination."""
    data, errors = log.io(joint if log.joint else None), {}
    u, y = data.u[:, 0], data.y[:, 0]
    for (on_u, on_y), name in SIGNS.items():
        trial = Follower(Log(on_u * u, on_y * y, log.Ts, None, joint, dict(log.meta)), joint, **follower)  # type: ignore[arg-type]
        (row,) = trial.readings([parameters])
        errors[name] = float(np.nan_to_num(np.std(trial.y - row), nan=np.inf))
    best = min(errors, key=lambda name: errors[name])
    if errors[best] > _TURNED * errors[""]:
        return ""
    single_signs = sorted((errors[name], name) for name in ("input", "output"))
    if best in ("input", "output") and single_signs[1][0] < _ALIKE * single_signs[0][0]:
        return "input or output"
    return best


def turn_back(log: Log, joint: str, signs: str) -> Log:
    """The log of `joint` alone, with the `signs` of `opposite_signs` turned back; of two possible ones the output's."""
    data = log.io(joint if log.joint else None)
    on_u = -1.0 if signs in ("input", "input and output") else 1.0
    on_y = -1.0 if signs in ("output", "input or output", "input and output") else 1.0
    return Log(on_u * data.u[:, 0], on_y * data.y[:, 0], log.Ts, None, joint, dict(log.meta))


def align(trials: Trials, verdict: Verdict | None, signs: str = "", applied_parts: tuple[str, ...] = ()) -> Alignment:
    """Delay, gear and offset between the log of `trials`, whose signs are turned back, and the twin.

    They are found by least squares in the twin, together with the start, with what `verdict` names, and with speed,
    friction, backlash and load, so that a departure of the twin does not pass for a delay or a slope. The intervals
    allow for coloured residuals, and for other parameters of the twin that are wrong by `DOUBT`. The delay is
    continuous.
    """
    joint, y = trials.follower.joint, trials.follower.y
    state = {} if verdict is None else dict(verdict.state)
    companions = [name.replace("JOINT", joint) for name in _BESIDE]
    plain = Search("alignment", _unique_knobs(*READ, *state), state)
    refine(trials, plain, y)
    knobs = _unique_knobs(*plain.knobs, *companions)
    deviations = {name: EXPECTED * trials.knobs[name].typical for name in companions if name not in state}
    begins = [Search("alignment", knobs, dict(place), expected=deviations) for place in (plain.state, state)]
    for begin in begins:
        begin.noise = noise_of(y) ** 2
    search = best_of(trials, begins, y, _ROUNDS)
    doubtful_knobs = (name.replace("JOINT", joint) for name in _DOUBTED)
    by_knob = by_name(values(trials, search, y, {name: DOUBT * trials.parameters[name] for name in doubtful_knobs}))
    delay, gear, offset = (
        replace(by_knob[name], name=part) for name, part in ((DELAY, "delay"), (SLOPE, "gear"), (ZERO, "offset"))
    )
    return Alignment(signs, delay, gear, offset, by_knob[START], applied_parts)


def _unique_knobs(*names: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for name in names if name != START))
