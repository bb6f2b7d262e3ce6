"""What `qpal compare` says of legs that have something the twin has not, by equations that the product does not use.

    python scripts/study.py foreign_legs [--seeds 3000:3008] [--kinds heat,cogging] [--docs]

`INSIDE` are structures that `qpal compare` can name, `OUTSIDE` those that it cannot: there any name is wrong. "one of
several": the true cause is among those that the verdict says act alike.
"""

import argparse
from collections.abc import Callable

import numpy as np
from study import MISSING, Study, markdown, words
from verdicts import judged, put_into_page

from twin.compare.standins import StandIn
from twin.experiment import Experiment
from twin.follow import Follower
from twin.hardware.linkage import end_angles, middle
from twin.log import Log
from twin.parameters import JOINTS, Parameters

TS, DURATION, DT = 0.05, 30.0, 0.001
NOISE = np.deg2rad(0.2)
_STANDS = np.deg2rad(0.02)
_EXCITATIONS: tuple[tuple[str, dict[str, float]], ...] = (("aprbs", {}), ("sweep", {"jitter": 0.5, "shrink": 0.4}))


class Leg:
    """A joint of the twin under an input, and what a draw makes of its course."""

    def __init__(self, joint: str, u: np.ndarray, rng: np.random.Generator) -> None:
        self.joint, self.u, self.rng, self.p = joint, u, rng, Parameters()
        self.t = np.arange(len(u)) * TS

    def uniform(self, low: float, high: float) -> float:
        """A number between two others."""
        return float(self.rng.uniform(low, high))

    def course(
        self, u: np.ndarray | None = None, p: Parameters | None = None, start: float | None = None
    ) -> np.ndarray:
        """Angles (steps,) [rad] every `DT`."""
        u = self.u if u is None else u
        first = middle(self.p, self.joint) if start is None else start
        Ts = TS if len(u) <= len(self.t) else DT
        follower = Follower(Log(u, np.full(len(u), first), Ts, joint=self.joint), self.joint, threads=1)
        return np.asarray(follower.courses([self.p if p is None else p])[0], dtype=float)

    def disturbed(self, volts: Callable[[np.ndarray, np.ndarray], np.ndarray], rounds: int = 40) -> np.ndarray:
        """The course where volts(angle, speed) act at the motor, every `DT`; found by repetition until it stands."""
        u, late, course = np.repeat(self.u, round(TS / DT)), round(self.p["delay"] / DT), self.course()
        for _ in range(rounds):
            x = course[: len(u)]
            ahead = np.append(volts(x, np.gradient(x, DT))[late:], np.zeros(late))
            course = self.course(u + ahead)
            if np.abs(course[: len(x)] - x).max() < _STANDS:
                break
        return course


def _spring(leg: Leg) -> np.ndarray:
    x, w, d = leg.course(), 2.0 * np.pi * leg.uniform(2.0, 8.0), leg.uniform(0.02, 0.2)
    y, v, out = x[0], 0.0, np.empty_like(x)
    for k, rate in enumerate(np.gradient(x, DT)):
        out[k] = y
        v += DT * (w * w * (x[k] - y) + 2.0 * d * w * (rate - v))
        y += DT * v
    return out


def _hysteresis(leg: Leg) -> np.ndarray:
    """Bouc and Wen's equation with an exponent of 1, by Euler steps."""
    x, size, way = leg.course(), np.deg2rad(leg.uniform(0.5, 3.0)), np.deg2rad(leg.uniform(1.0, 6.0))
    z, out = 0.0, np.array(x)
    for k, dx in enumerate(np.diff(x), 1):
        z += (dx - abs(dx) * z) / way
        out[k] = x[k] - size * z
    return out


def _creep(leg: Leg) -> np.ndarray:
    x, size = leg.course(), np.deg2rad(leg.uniform(0.5, 3.0)) * leg.rng.choice([-1, 1])
    return x + size * (1.0 - np.exp(-np.arange(len(x)) * DT / leg.uniform(5.0, 40.0)))


def _wave(leg: Leg) -> np.ndarray:
    x = leg.course()
    return x + np.deg2rad(leg.uniform(0.3, 1.5)) * np.sin(leg.uniform(3.0, 20.0) * x + leg.uniform(0.0, 6.0))


def _give(leg: Leg) -> np.ndarray:
    x, size, time = leg.course(), np.deg2rad(leg.uniform(0.05, 0.25)), leg.uniform(0.03, 0.2)
    w, out = 0.0, np.empty_like(x)
    for k, angle in enumerate(x):
        w += DT / time * (leg.u[min(int(k * DT / TS + 1e-9), len(leg.u) - 1)] - w)
        out[k] = angle + size * w
    return out


def _heat(leg: Leg) -> np.ndarray:
    share, time = leg.uniform(0.1, 0.4), leg.uniform(5.0, 30.0)
    return leg.course(leg.u * (1.0 - share * (1.0 - np.exp(-leg.t / time))))


def _cogging(leg: Leg) -> np.ndarray:
    size, waves = leg.uniform(0.4, 1.5), leg.uniform(10.0, 60.0)
    return leg.disturbed(lambda x, v: size * np.sin(waves * x))


def _place(leg: Leg) -> np.ndarray:
    size, place, width = (
        leg.uniform(0.5, 2.0),
        middle(leg.p, leg.joint) + leg.uniform(-0.3, 0.3),
        leg.uniform(0.05, 0.15),
    )
    return leg.disturbed(lambda x, v: -size * np.tanh(v / 0.02) * np.exp(-(((x - place) / width) ** 2)))


def _weight_added(leg: Leg) -> np.ndarray:
    n, mass = round(leg.uniform(0.3, 0.7) * len(leg.u)), leg.uniform(0.4, 1.5)
    before, steps = leg.course(), round(TS / DT)
    heavier = leg.p.replace({"foot_mass": leg.p["foot_mass"] + mass})
    after = leg.course(leg.u[n:], heavier, start=float(before[n * steps]))
    return np.concatenate([before[: n * steps], after])


def _drag(leg: Leg) -> np.ndarray:
    size = leg.uniform(0.1, 0.5)
    return leg.disturbed(lambda x, v: -2.0 * size * np.sign(v) * np.sqrt(np.abs(v) / 0.2))


def _late_at_times(leg: Leg) -> np.ndarray:
    x = leg.course()
    t, delays = np.arange(len(x)) * DT, leg.rng.uniform(0.0, 0.2, int(DURATION) + 2)
    return np.interp(t - np.repeat(delays, round(1.0 / DT))[: len(x)], t, x)


def _weak_one_way(leg: Leg) -> np.ndarray:
    share = leg.uniform(0.05, 0.3)
    return leg.course(np.where(leg.u > 0.0, (1.0 - share) * leg.u, leg.u))


def _sensor_slips(leg: Leg) -> np.ndarray:
    x = leg.course()
    return x + np.where(np.arange(len(x)) * DT > leg.uniform(8.0, 22.0), np.deg2rad(leg.uniform(0.5, 4.0)), 0.0)


def _ripple(leg: Leg) -> np.ndarray:
    return leg.course(leg.u * (1.0 + leg.uniform(0.1, 0.3) * np.sin(leg.uniform(0.5, 6.0) * leg.t)))


def _pause_at_reversals(leg: Leg) -> np.ndarray:
    """The bridge stays off for some samples after each change of the command's sign."""
    n, u = int(leg.rng.integers(2, 6)), np.array(leg.u)
    for k in np.flatnonzero(np.diff(np.sign(leg.u))) + 1:
        u[k : k + n] = 0.0
    return leg.course(u)


def _soft_end(leg: Leg) -> np.ndarray:
    high = end_angles(leg.p, leg.joint)[1]
    way, size = leg.uniform(0.1, 0.4), leg.uniform(2.0, 6.0)
    return leg.disturbed(lambda x, v: -size * np.maximum(x - high + way, 0.0) / way)


def _slew(leg: Leg) -> np.ndarray:
    """The board lets the voltage change by so much a sample."""
    step, u, now = leg.uniform(0.5, 2.0), np.array(leg.u), 0.0
    for k, asked in enumerate(leg.u):
        now += np.clip(asked - now, -step, step)
        u[k] = now
    return leg.course(u)


INSIDE = {
    **{"spring": _spring, "hysteresis": _hysteresis, "creep": _creep, "wave": _wave, "give": _give},
    **{"heat": _heat, "cogging": _cogging, "place": _place, "drag": _drag},
}
OUTSIDE = {
    **{"weight added": _weight_added, "late at times": _late_at_times, "weak one way": _weak_one_way},
    **{"sensor slips": _sensor_slips, "ripple": _ripple, "pause at reversals": _pause_at_reversals},
    **{"soft end": _soft_end, "slew": _slew},
}
FOREIGN = INSIDE | OUTSIDE


def foreign_leg(kind: str, seed: int) -> StandIn:
    """The stand-in number `seed` of a kind of `FOREIGN`."""
    rng = np.random.default_rng([seed, list(FOREIGN).index(kind), 35])
    joint = str(rng.choice(JOINTS))
    excitation, options = _EXCITATIONS[int(rng.integers(len(_EXCITATIONS)))]
    u = Experiment(joint, excitation, DURATION, TS, seed=seed, options=options).commands()[:, 0]
    x = FOREIGN[kind](Leg(joint, u, rng))
    y = np.interp(np.arange(len(u)) * TS, np.arange(len(x)) * DT, x) + NOISE * rng.standard_normal(len(u))
    return StandIn(kind, joint, excitation, "", Log(u, y, TS, None, joint, {"source": "stand-in"}))


def score(case: tuple[str, int], options: argparse.Namespace) -> dict[str, object]:
    """The verdict on one stand-in, and what kind of answer it is."""
    row = judged(foreign_leg(*case))
    kind, named = case[0], str(row["named"])
    if kind == named:
        answer = "right"
    elif named in ANSWERS:
        answer = named
    else:
        answer = "one of several" if kind in row["alike"] else "wrong"  # type: ignore[operator]
    return row | {"answer": answer}


def summary(rows: list[dict], options: argparse.Namespace) -> str:
    """The table of answers by what is foreign; with --docs it also goes into docs/compare.md."""
    lines = []
    for kind in options.kinds:
        group = [row for row in rows if row["effect"] == kind]
        size = [row["departure"] for row in group]
        counts = [sum(row["answer"] == answer for row in group) for answer in ANSWERS]
        place = "yes" if kind in INSIDE else "no"
        lines.append([kind, place, *(n or MISSING for n in counts), f"{min(size):.2f} to {max(size):.2f}"])
    text = markdown(["foreign", "known to compare", *ANSWERS, "departure [deg]"], lines) + "\n"
    if options.docs:
        put_into_page(text, "foreign_legs")
    return text


ANSWERS = ("right", "one of several", "unknown", "nothing", "wrong")
STUDY = Study(
    cases=lambda options: [(kind, seed) for seed in options.seeds for kind in options.kinds],
    score=score,
    summary=summary,
    seeds="3000:3008",
    options={
        "--kinds": {"type": words, "default": list(FOREIGN)},
        "--docs": {"action": "store_true", "help": "write the table into docs/compare.md"},
    },
)
