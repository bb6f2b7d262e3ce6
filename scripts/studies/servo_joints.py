"""Drawn servo joints: goal to angle fitted on one half of each record, run freely over the other.

    python scripts/study.py servo_joints [--seeds 0:50] [--draw 0] [--all-parts]

Every joint is drawn from the seed: motor, friction with Stribeck curve, pendulum, backlash, P or PD loop at 1 kHz with
saturation and a quantised encoder, transport delay, noise. It is simulated here in steps of 0.1 ms, by none of the
library's blocks. Half of the fits know the loop's gains. The ceiling is the fit of the noise-free angle.
"""

import argparse
import time
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from study import Study

import sysid
from sysid import IOData
from sysid.base.criteria import fit_percent
from sysid.blocks import ServoMotor
from sysid.joint.posterior import fit_joint
from sysid.structures import servo_joint

STEP = 1e-4  # s
LOOP = 10  # steps of one update of the servo: 1 kHz
TICK = 2 * np.pi / 4096  # rad, of the encoder
FILTER = 0.2  # share of the new rate in the loop's derivative, per update
WITHIN = 0.5  # points of the ceiling


@dataclass(frozen=True)
class Joint:
    """A servo joint: speeds in rad/s, times in s, drives as shares of full duty, angles in rad."""

    speed: float  # at full duty, without friction
    lag: float
    up: float
    down: float
    stick: float
    stick_speed: float
    pull: float  # of the pendulum
    tilt: float  # angle at which it hangs straight down
    backlash: float
    kp: float
    kd: float
    delay: float
    noise: float
    Ts: float
    known: bool


def drawn(rng: np.random.Generator) -> Joint:
    """One joint."""

    def log_uniform(low: float, high: float) -> float:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    speed, friction, skew = log_uniform(3.0, 12.0), log_uniform(0.02, 0.15), rng.uniform(-0.15, 0.15)
    sticks, hangs, slack, derives, gains_known = rng.random(5) < 0.5
    return Joint(
        speed=speed,
        lag=log_uniform(0.015, 0.08),
        up=friction * (1 + skew),
        down=friction * (1 - skew),
        stick=friction * rng.uniform(0.1, 0.6) * sticks,
        stick_speed=log_uniform(0.05, 0.4),
        pull=rng.uniform(0.05, 0.3) * hangs,
        tilt=rng.uniform(-0.5, 0.5),
        backlash=np.radians(rng.uniform(0.2, 1.5)) * slack,
        kp=log_uniform(2.0, 15.0),
        kd=log_uniform(0.1, 1.0) / speed * derives,
        delay=rng.uniform(0.0, 0.02),
        noise=np.radians(log_uniform(0.03, 0.3)),
        Ts=float(rng.choice([0.01, 0.02])),
        known=bool(gains_known),
    )


def goals(rng: np.random.Generator, N: int, Ts: float) -> np.ndarray:
    """Goal (N,) [rad]: steps of drawn levels and times, then two sines, in turns of about 5 s."""
    out, t = np.zeros(N), np.arange(N) * Ts
    turn = round(5.0 / Ts)
    for k, start in enumerate(range(0, N, turn)):
        part = slice(start, min(start + turn, N))
        if k % 2 == 0:
            i = start
            while i < part.stop:
                hold = round(rng.uniform(0.2, 1.0) / Ts)
                out[i : min(i + hold, part.stop)] = rng.uniform(-1.2, 1.2)
                i += hold
        else:
            slow, fast = rng.uniform(0.15, 0.5), rng.uniform(0.6, 2.0)
            a, b = rng.uniform(0.4, 0.9), rng.uniform(0.1, 0.3)
            out[part] = a * np.sin(2 * np.pi * slow * t[part]) + b * np.sin(2 * np.pi * fast * t[part])
    return out


@numba.njit
def _run(goal, steps_per_sample, delay_steps, speed, lag, rise, fall, stick, stick_speed, pull, tilt, backlash, kp, kd):
    """Angle of the link (N,) [rad] by steps of `STEP`, the servo's loop included."""
    angle, rate, link, drive = goal[0], 0.0, goal[0], 0.0
    last, slope = np.round(angle / TICK) * TICK, 0.0
    out = np.empty(len(goal))
    for n in range(len(goal) * steps_per_sample):
        if n % steps_per_sample == 0:
            out[n // steps_per_sample] = link
        if n % LOOP == 0:
            target = goal[max(n - delay_steps, 0) // steps_per_sample]
            read = np.round(angle / TICK) * TICK
            slope += FILTER * ((read - last) / (LOOP * STEP) - slope)
            last = read
            drive = min(max(kp * (target - read) - kd * slope, -1.0), 1.0)
        push = drive - pull * np.sin(angle - tilt)
        hold = stick * np.exp(-((rate / stick_speed) ** 2))
        if rate == 0.0:
            if -fall - hold <= push <= rise + hold:
                continue
            way = 1.0 if push > 0 else -1.0
        else:
            way = 1.0 if rate > 0 else -1.0
        force = push - way * ((rise if way > 0 else fall) + hold)
        new = rate + STEP * (speed * force - rate) / lag
        if rate != 0.0 and new * rate < 0.0:
            new = 0.0
        angle += STEP * 0.5 * (rate + new)
        rate = new
        link = min(max(link, angle - backlash / 2), angle + backlash / 2)
    return out


def simulated(joint: Joint, goal: np.ndarray) -> np.ndarray:
    """Noise-free angle of the link (N,) [rad]."""
    j = joint
    motor = (j.speed, j.lag, j.up, j.down, j.stick, j.stick_speed, j.pull, j.tilt, j.backlash, j.kp, j.kd)
    return _run(goal, round(j.Ts / STEP), round(j.delay / STEP), *motor)


def record(joint: Joint, rng: np.random.Generator, seconds: float = 30.0) -> tuple[IOData, np.ndarray]:
    """Goal and measured angle, and the angle without noise."""
    goal = goals(rng, round(seconds / joint.Ts), joint.Ts)
    y = simulated(joint, goal)
    read = np.round((y + joint.noise * rng.normal(size=len(y))) / TICK) * TICK
    return IOData(goal, read, joint.Ts, "goal", "angle", "rad", "rad"), y


def model(joint: Joint, play: bool) -> sysid.Chain:
    """The chain to fit: the kind of loop is known, its gains on half of the joints; with `play` any backlash."""
    motor = ServoMotor(load=0, periodic=1, stops=False, loop="pd" if joint.kd else "p")
    gains = {"motor.kp": joint.kp} | ({"motor.kd": joint.kd / joint.Ts} if joint.kd else {})
    return servo_joint(motor, play=play and bool(joint.backlash), fixed=gains if joint.known else {})


def score(case: tuple[int], options: argparse.Namespace) -> dict[str, Any]:
    """Fit, ceiling and seconds of joint k."""
    (k,) = case
    rng = np.random.default_rng([options.draw, k])
    joint = drawn(rng)
    data, truth = record(joint, rng)
    half = data.N // 2
    train, test = data.select(0, half), data.select(half, data.N)
    start = time.perf_counter()
    chain = model(joint, play=not options.all_parts)
    fit = fit_joint(train, chain).fit if options.all_parts else sysid.fit(chain, train, search="lm", starts=4)
    seconds = time.perf_counter() - start
    ceiling = fit_percent(test.y, truth[half:, None])
    percents = {"fit": fit.fit_percent(test), "ceiling": ceiling, "train": fit.fit_percent(train)}
    kind = f"{'pd' if joint.kd else 'p'} {'known' if joint.known else ''} {'stick' if joint.stick else ''} "
    kind += f"{'load' if joint.pull else ''} {'play' if joint.backlash else ''} Ts {joint.Ts} kp {joint.kp:.1f}"
    return {name: float(np.ravel(value)[0]) for name, value in percents.items()} | {"seconds": seconds, "kind": kind}


def line(r: dict[str, Any]) -> str:
    """One joint."""
    return (
        f"{r['case'][0]:3d} {r['fit']:7.2f} of {r['ceiling']:6.2f} ({r['fit'] - r['ceiling']:6.2f}) train "
        f"{r['train']:6.2f} {r['seconds']:5.1f} s  {r['kind']}"
    )


def summary(rows: list[dict[str, Any]], options: argparse.Namespace) -> str:
    """Every joint, and how many are near the ceiling."""
    gaps = np.array([r["ceiling"] - r["fit"] for r in rows])
    count = int(np.sum(gaps <= WITHIN))
    counts = (
        f"{count} of {len(rows)} within {WITHIN} of the ceiling; worst {gaps.max():.2f}, median {np.median(gaps):.2f}"
    )
    return "\n".join([*map(line, rows), counts, f"median {np.median([r['seconds'] for r in rows]):.1f} s a fit"])


STUDY = Study(
    cases=lambda options: ((k,) for k in options.seeds),
    score=score,
    summary=summary,
    seeds="0:50",
    options={
        "--draw": {"type": int, "default": 0, "help": "seed of all joints, beside the number of each"},
        "--all-parts": {"action": "store_true", "help": "all parts at once, by `sysid.fit_joint`"},
    },
    line=line,
)
