"""Settings for an experiment that stays inside the stroke or reaches both ends, found on the noise-free twin.

A voltage-driven joint integrates: load, asymmetric friction or an uneven signal make it drift into an end.
"""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from sysid.base.checks import checked
from sysid.base.errors import InputError, unknown
from twin.experiment import Experiment
from twin.imperfections import of_group
from twin.parameters import JOINTS
from twin.truth import Truth, truth

WHERE = ("inside", "ends")
QUIET = of_group("sensor")  # what moves is what is judged
TOUCH = 0.03  # share of the stroke that switch and play may leave between a joint at its end and the end
MOVES = 0.02  # share of the stroke, play apart, below which friction has held the joint
ENOUGH = 0.4  # share of the stroke that an experiment inside should use, or the next setting is tried
FURTHEST = 0.25  # share of the supply voltage that an offset may add to what carries the load
SMALLEST = 0.01  # share of a setting at which the search gives up

STRETCHES = (1.5, 2.25, 3.4, 5.0)


@checked(late=True)
def fit_stroke(experiment: Experiment, where: str = "inside", margin: float = 0.05) -> Experiment:
    """`experiment` with options changed so that its joint stays inside its stroke or reaches both ends.

    "inside": the joint stays away from both ends by `margin`, a share of the stroke. Amplitude, times or reach are
    reduced as little as possible and never increased; an offset compensates drift. "ends": the joint reaches both
    ends, also with an amplitude smaller by `margin`; the amplitude is raised up to the supply voltage, then the holds
    become longer. Settings that already suffice are kept. The design runs the twin with the experiment's parameters
    and seed and a perfect sensor; another seed needs a new design. Takes up to some tens of runs. Raises InputError,
    with the closest result, if no setting fits.
    """
    if experiment.joint not in JOINTS:
        raise InputError(f"joint is {experiment.joint!r}; design one joint at a time, of {', '.join(JOINTS)}")
    if where not in WHERE:
        raise unknown("where", where, WHERE)
    if isinstance(margin, bool) or not isinstance(margin, int | float) or not 0 <= margin <= 0.4:
        raise InputError(f"margin is {margin!r}; give a share of the stroke from 0 to 0.4")
    bench = _Bench(experiment, float(margin))
    return bench.keep_inside() if where == "inside" else bench.reach_ends()


@dataclass(frozen=True)
class Travel:
    """Smallest and largest angle of a run as shares of the stroke, and its options."""

    low: float
    high: float
    options: dict[str, Any]

    @property
    def width(self) -> float:
        return self.high - self.low

    def __str__(self) -> str:
        return f"{100 * self.low:.0f} % to {100 * self.high:.0f} % of the stroke"


@dataclass
class _Bench:
    experiment: Experiment
    margin: float
    offset: float = 0.0  # where the last search for one ended, and the next begins [V]
    tried: dict[str, Travel] = field(default_factory=dict)

    def __post_init__(self) -> None:
        e = self.experiment
        self.kind = e.signal()
        self.signal = asdict(self.kind)  # type: ignore[call-overload]
        self.truth: Truth = truth(e.joint, e.Ts, e.p, mode=e.mode)
        self.lower, self.stroke = self.truth.end_angles[0], float(np.ptp(self.truth.end_angles))
        self.voltage = e.mode == "voltage"
        self.offset = self.signal["offset"]
        self.full = self.stroke / self.truth.gain  # [V s] across the stroke, friction apart; [V] in servo mode
        v_down, v_up = self.truth.breakaway_voltage
        self.starts = max(-v_down, v_up) < e.p["supply_voltage"]
        # [V] what carries the load at mid stroke, and half of the voltages around it that friction swallows
        self.balance, self.dead = (
            (round((v_down + v_up) / 2, 4), (v_up - v_down) / 2) if self.starts else (self.offset, 0.0)
        )
        if not self.voltage:
            self.balance = self.offset
        self.most = e.p["supply_voltage"] if self.voltage else max(self.signal["amplitude"], 0.75 * self.full)

    @property
    def name(self) -> str:
        """For sentences."""
        return f"{self.experiment.excitation} on the {self.experiment.joint}"

    def travel(self, options: dict[str, Any]) -> Travel:
        """The travel of a run with `options`; cached, because a search may use them again."""
        key = repr(sorted(options.items()))
        if key not in self.tried:
            e = self.experiment
            quiet = tuple(dict.fromkeys((*e.without, *QUIET)))
            y = replace(e, options={**e.options, **options}, without=quiet).run().y_true
            assert y is not None
            low, high = (float(end - self.lower) / self.stroke for end in (y.min(), y.max()))
            self.tried[key] = Travel(low, high, options)
        return self.tried[key]

    # Inside the stroke.

    def keep_inside(self) -> Experiment:
        first_travel = self.travel({})
        if self._side(first_travel) == 0:
            self._check_moves(first_travel)
            return self.experiment
        best: Travel | None = None
        for setting in self._settings():
            travel = self._largest(setting)
            if travel and (best is None or travel.width > best.width):
                best = travel
            if best and best.width >= ENOUGH:
                break
        if best is None:
            raise InputError(
                f"{self.name} leaves the stroke even at {100 * SMALLEST:g} % of its "
                f"{' or '.join(self._settings())}; give a shorter record, or other frequencies or levels"
            )
        self._check_moves(best)
        return replace(self.experiment, options={**self.experiment.options, **best.options})

    def _settings(self) -> tuple[str, ...]:
        if not self.voltage:
            return ("amplitude",)
        return self.kind.travel_less

    def _largest(self, setting: str) -> Travel | None:
        """The travel inside the stroke with the largest share of `setting` for which an offset exists."""
        best, ok, bad = None, SMALLEST, 1.0
        guess = 1.0
        while bad / ok > 1.08 or best is None:
            travel = self._centre(self._reduce(setting, guess), self._side)
            if travel is None:
                if guess <= SMALLEST:
                    return None
                bad = guess
            else:
                best, ok = travel, guess
                if guess == 1.0 or travel.width > 0.85 * (1 - 2 * self.margin):
                    return best
            middle = float(np.sqrt(ok * bad)) if best or bad > 0.1 else SMALLEST
            # What moves grows a little faster than the setting, since friction takes its part off.
            extrapolation = ok * (1 - 2 * self.margin) / best.width if best and best.width > 0.2 else np.inf
            guess = min(max(extrapolation, ok * 1.05), middle) if best else middle
        return best

    def _reduce(self, setting: str, share: float) -> dict[str, Any]:
        value = self.signal[setting]
        options: dict[str, Any] = {}
        if setting == "reach":
            options["dead"] = self.signal["dead"] or _tidy(self.dead)
            value = min(value or np.inf, 0.6 * self.full)
        if self.voltage:
            options |= self.kind.centred
        least = self.kind.least_samples[setting] * self.experiment.Ts if setting in self.kind.least_samples else 0.0
        return options | {setting: max(_tidy(share * value), least)}

    def _side(self, travel: Travel) -> int:
        """0: inside. 1, -1: beyond the upper or lower end. 2: beyond both ends, so that no offset helps."""
        out = travel.high > 1 - self.margin, travel.low < self.margin
        return 2 if all(out) else out[0] - out[1]

    def _check_moves(self, travel: Travel) -> None:
        """Raises InputError if friction holds the joint in `travel`, with the voltages that would start it."""
        play = self.truth.backlash / self.stroke
        if travel.width - play >= MOVES:
            return
        v_down, v_up = self.truth.breakaway_voltage
        amplitude = travel.options.get("amplitude", self.signal["amplitude"])
        if self.starts:
            finding = f"its break-away voltages are {v_down:.3g} V and {v_up:.3g} V"
            advice = "give a larger amplitude"
        else:
            finding = f"and the supply's {self.most:.3g} V are below its break-away voltage"
            advice = "lower the friction or the load in the parameters, or raise the supply voltage"
        if travel.options:  # it was turned down to here
            finding += ", and a larger amplitude drives it out of the stroke"
            advice = "give shorter holds, higher frequencies or a shorter record"
        raise InputError(f"{self.name} does not move with an amplitude of {amplitude:.3g} V, {finding}; {advice}")

    # To both ends.

    def reach_ends(self) -> Experiment:
        nearest = self.travel({})
        for options in self._increase():
            try:
                travel = self._centre(options, self._missing)
                nearest = max((*self.tried.values(), nearest), key=lambda travel: travel.width)
            except InputError:  # a stretched time that no longer fits the record
                break
            if travel:
                return replace(self.experiment, options={**self.experiment.options, **travel.options})
        raise InputError(
            f"{self.name} does not reach both ends within {self.experiment.duration:g} s (with "
            f"{100 * self.margin:g} % less amplitude too), at best it moves from {nearest}; "
            f"give longer holds, lower frequencies or a longer record"
        )

    def _increase(self) -> Iterator[dict[str, Any]]:
        """Options in the order in which they are tried to reach both ends: amplitude, reach, longer times."""
        yield {}
        amplitude = self.signal["amplitude"]
        options: dict[str, Any] = {}
        if amplitude < self.most:
            options["amplitude"] = _tidy(self.most)
            yield options
        if self.signal.get("reach"):
            options = options | {"reach": 0.0}
            yield options
        times = self.kind.travel_more
        for stretch in STRETCHES if times else ():
            if 4 * stretch * max(self.signal[name] for name in times) > self.experiment.duration:
                return  # a record of a few levels shows little else
            yield options | {name: _tidy(stretch * self.signal[name]) for name in times}

    def _missing(self, travel: Travel) -> int:
        """0: both ends are reached, also with the smaller amplitude. 1, -1: only the upper or lower one. 2: neither."""
        amplitude = travel.options.get("amplitude", self.signal["amplitude"])
        weaker = self.travel(travel.options | {"amplitude": amplitude * (1 - self.margin)})
        meets = [
            all(run.high > 1 - TOUCH for run in (travel, weaker)),
            all(run.low < TOUCH for run in (travel, weaker)),
        ]
        return 0 if all(meets) else meets[0] - meets[1] or 2

    # An offset for either.

    def _centre(self, options: dict[str, Any], side: Callable[[Travel], int]) -> Travel | None:
        """The first travel with side 0 over the offsets; None if none is found.

        A larger offset never moves a joint further down, so the offset is bracketed and then bisected.
        """
        bracket = [-np.inf, np.inf]
        for offset in self._offsets(bracket):
            travel = self._travel_with_offset(options, offset)
            position = side(travel)
            if position == 0:
                self.offset = offset
                return travel
            if position == 1:
                bracket[1] = min(bracket[1], offset)
            elif position == -1:
                bracket[0] = max(bracket[0], offset)
            elif np.isfinite(bracket).any():
                return None
        return None

    def _offsets(self, bracket: list[float]) -> Iterator[float]:
        """The last offset, the offset that carries the load at mid stroke, then points of `bracket` [V]."""
        yield from dict.fromkeys((self.offset, self.balance))
        step = 0.3 * self.full / (self.experiment.duration if self.voltage else 1.0)  # [V] for 30 % of the stroke
        for _ in range(12):
            low, high = bracket
            if np.isfinite([low, high]).all():
                offset = (low + high) / 2
            elif np.isfinite([low, high]).any():
                offset = low + step if np.isfinite(low) else high - step
                step *= 2
            else:
                return
            if abs(offset - self.balance) > FURTHEST * self.most or high - low < 2e-4 * self.most:
                return
            yield round(offset, 4)

    def _travel_with_offset(self, options: dict[str, Any], offset: float) -> Travel:
        if offset != self.signal["offset"]:
            options = options | {"offset": offset}
            amplitude = options.get("amplitude", self.signal["amplitude"])
            if self.voltage and amplitude + abs(offset) > self.most:  # the bridge would cut the peaks
                options["amplitude"] = int(1e3 * (self.most - abs(offset))) / 1e3
        return self.travel(options)


def _tidy(value: float) -> float:
    """Rounded to four digits, so that the settings shown are exactly those that were tried."""
    return float(f"{value:.4g}")
