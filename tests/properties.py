"""What may be done to a record without another fit: signs, clock, digits, order and division, for each structure."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from cases import BLOCKS
from exported import JOINT, JOINTS, sweep
from scipy.signal import lfilter

import sysid
from sysid.nlarx.result import NlarxFit
from sysid.structures import TABLE

S = sysid.structures
NOISE = 0.01  # of the output's spread


def plant(seed: int, before: bool = False, behind: bool = False, N: int = 400) -> sysid.IOData:
    """A filter of two poles, with a dead zone before and a bend behind it where asked, and a little noise."""
    rng = np.random.default_rng([seed, 5])
    u = np.repeat(rng.normal(0.3 if before else 0.0, 1.0, N // 5), 5)
    x = np.where(np.abs(u) > 0.3, u - 0.3 * np.sign(u), 0.0) if before else u
    y = lfilter([0.0, 0.2, 0.1], [1.0, -1.3, 0.42], x)
    return noisy(u, y + 0.15 * y**2 if behind else y, rng)


def profile(seed: int, N: int = 400) -> sysid.IOData:
    """A motor with a friction that depends on its place."""
    rng = np.random.default_rng([seed, 13])
    block, theta = BLOCKS["profiled_motor"]
    u = np.repeat(rng.uniform(-1.5, 1.5, N // 10), 10)
    return noisy(u, block.output(theta, u), rng)


def noisy(u: np.ndarray, y: np.ndarray, rng: np.random.Generator) -> sysid.IOData:
    """The record with white noise on its output."""
    return sysid.IOData(u, y + NOISE * np.std(y) * rng.standard_normal(len(y)), 0.1)


def joint(seed: int, name: str = "plain", N: int = 600) -> sysid.IOData:
    """A joint across its stroke, with its stops or without."""
    chain = JOINTS[name]
    theta = np.array([JOINT.get(n, 0.0) for n in chain.names])
    u = 3.0 * sweep(N) if name == "plain" else np.repeat(np.random.default_rng(seed).uniform(-9, 9, N // 10), 10)
    return noisy(u, chain.outputs(theta, u).ravel(), np.random.default_rng([seed, 7]))


def servo(seed: int, N: int = 400) -> sysid.IOData:
    """A servo that follows a goal with a lag and a limit of its speed."""
    rng = np.random.default_rng([seed, 9])
    goal = np.repeat(rng.uniform(-1.0, 1.0, N // 20), 20)
    y = np.zeros(N)
    for t in range(1, N):
        y[t] = y[t - 1] + np.clip(0.3 * (goal[t - 1] - y[t - 1]), -0.12, 0.12)
    return noisy(goal, y, rng)


def drives(seed: int, N: int = 400) -> sysid.IOData:
    """Coupled drives: the size of a speed is measured."""
    rng = np.random.default_rng([seed, 11])
    u = np.repeat(rng.normal(0.0, 1.0, N // 10), 10)
    return noisy(u, np.abs(lfilter([0.0, 0.1, 0.05], [1.0, -1.5, 0.6], u)), rng)


CASES: dict[str, tuple[Callable[[], object], Callable[[int], sysid.IOData]]] = {
    "armax": (lambda: S.armax(2, 2, 1), plant),
    "arx": (lambda: S.arx(2, 2, 1), plant),
    "bj": (lambda: S.bj(2, 2, 1, 1, 1), plant),
    "coupled_drives": (lambda: S.coupled_drives(2, 2, 1), drives),
    "hammerstein": (lambda: S.hammerstein(2, 2, 1), partial(plant, before=True)),
    "hammerstein_wiener": (
        lambda: S.hammerstein_wiener(2, 2, 1, input="dead_zone", output="polynomial"),
        partial(plant, before=True, behind=True),
    ),
    "motor_profile": (lambda: S.motor_profile(3), profile),
    "nlarx": (lambda: S.nlarx(2, 2, 1, units=2), partial(plant, behind=True)),
    "output_error": (lambda: S.output_error(2, 2, 1), plant),
    "process": (lambda: S.process("P2D", offset="free"), plant),
    "servo_joint": (lambda: S.servo_joint(), servo),
    "state_space": (lambda: S.state_space(2, 0, degree=2), partial(plant, behind=True)),
    "wiener": (lambda: S.wiener(2, 2, 1, output="polynomial"), partial(plant, behind=True)),
    "wiener_hammerstein": (lambda: S.wiener_hammerstein(1, 1, 0, 1, 1, 1, middle="polynomial"), plant),
    "actuated_joint": (lambda: S.actuated_joint(), joint),
    "actuated_joint without stops": (
        lambda: S.actuated_joint(motor=sysid.blocks.Motor(load=0, delayed=False, stops=False), knots=None, play=False),
        lambda seed: joint(seed, "without_stops", 400),
    ),
}
assert {name.split()[0] for name in CASES} == set(TABLE)


def run_of(fit, data: sysid.IOData) -> np.ndarray:
    """The free run (N,) of a fit; the prediction one step ahead of a network, which is what it was fitted to."""
    return fit.predict(data) if isinstance(fit, NlarxFit) else fit.simulate(data)


def fitted(name: str, data: sysid.IOData, starts: int = 1):
    return sysid.fit(CASES[name][0](), data, starts=starts)


def turned(data: sysid.IOData, of: str) -> sysid.IOData:
    """The record with the input, the output or both turned."""
    return replace(data, u=-data.u if "u" in of else data.u, y=-data.y if "y" in of else data.y)


def rounded(data: sysid.IOData, digits: int) -> sysid.IOData:
    """The record as a text with so many digits has it."""
    text = [[float(f"{value:.{digits}g}") for value in column] for column in (data.u[:, 0], data.y[:, 0])]
    return replace(data, u=np.array(text[0]), y=np.array(text[1]))


def halves(data: sysid.IOData) -> tuple[sysid.IOData, sysid.IOData]:
    """The record as two files have it."""
    return data.select(0, data.N // 2), data.select(data.N // 2, data.N)
