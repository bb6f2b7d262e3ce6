"""Records as they should not be: each scenario spoils the estimation record in one way, and the test is whole."""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.base.errors import unknown
from sysid.bench.task import Task, Truth
from sysid.data.record import IOData
from sysid.excitations.aprbs import Aprbs
from sysid.model.chain import Chain
from sysid.structures import hammerstein, output_error, wiener

N, SHORT, DROP, NOISE, TS = 1000, 60, 50, 0.02, 0.1
MAPS = ("none", "input", "output")  # where the plant saturates


@dataclass(frozen=True)
class Plant:
    """A chain of two poles and gain 1 at rest, with its parameters; `about` says what was drawn."""

    chain: Chain
    theta: np.ndarray
    poles: np.ndarray
    about: str

    def run(self, u: np.ndarray) -> np.ndarray:
        """Clean output (N,) from rest."""
        return self.chain.simulate(self.theta, u)


@dataclass(frozen=True)
class Record:
    """Input u (N,) and output y (N,) of a record, where y is `missing` (N,), and the size of its white noise.

    scale: units of u and y in which the task is told, one of the plant's own units each.
    """

    u: np.ndarray
    y: np.ndarray
    noise: float
    given: str
    missing: np.ndarray | None = None
    scale: tuple[float, float] = (1.0, 1.0)


def draw_plant(rng: np.random.Generator) -> Plant:
    """Two poles, real or a pair, one zero, and a saturation before or behind them, or none."""
    if rng.random() < 0.5:
        poles = rng.uniform(0.5, 0.95, 2).astype(complex)
    else:
        z = rng.uniform(0.6, 0.95) * np.exp(1j * rng.uniform(0.05, 1.0))
        poles = np.array([z, z.conjugate()])
    f = np.poly(poles).real
    zero = rng.uniform(-0.5, 0.5)
    b = f.sum() / (1.0 + zero) * np.array([1.0, zero])
    map_place, low, high = str(rng.choice(MAPS)), *rng.uniform(0.4, 0.8, 2)
    linear = [*b, *f[1:]]
    chain, values = {
        "none": (output_error(2, 2, 1), linear),
        "input": (hammerstein(2, 2, 1, "saturation"), [-low, high, *linear]),
        "output": (wiener(2, 2, 1, "saturation"), [*linear, -low, high]),
    }[map_place]
    return Plant(chain, _at_rest(chain, values), poles, f"poles {_words(poles)}, saturation: {map_place}")


def record(plant: Plant, rng: np.random.Generator, n: int = N, u: np.ndarray | None = None) -> Record:
    """A good record: random levels and 2 % white noise."""
    u = _levels(n, rng) if u is None else u
    clean = plant.run(u)
    noise = NOISE * float(clean.std())
    return Record(u, clean + noise * rng.standard_normal(len(u)), noise, f"{len(u)} samples")


def short(plant: Plant, rng: np.random.Generator) -> Record:
    """As many samples as two poles barely need."""
    return record(plant, rng, SHORT)


def poor(plant: Plant, rng: np.random.Generator) -> Record:
    """One sine: it is persistently exciting of order 2, and the plant has four linear parameters."""
    period = rng.uniform(20.0, 80.0)
    good = record(plant, rng, u=np.sin(2.0 * np.pi * np.arange(N) / period))
    return replace(good, given=f"one sine of period {period:.0f} samples")


def outliers(plant: Plant, rng: np.random.Generator) -> Record:
    """2 % of the outputs are off by 3 to 10 standard deviations."""
    good = record(plant, rng)
    hit = rng.random(N) < 0.02
    size = rng.uniform(3.0, 10.0, N) * rng.choice([-1.0, 1.0], N) * good.y.std()
    return replace(good, y=np.where(hit, good.y + size, good.y), given=f"{hit.sum()} outliers in {N} samples")


def missing(plant: Plant, rng: np.random.Generator) -> Record:
    """A sixth of the outputs was not measured, in gaps of 1 to 20 samples."""
    good, is_missing = record(plant, rng), np.zeros(N, dtype=bool)
    while is_missing.mean() < 1.0 / 6.0:
        k = int(rng.integers(1, N - 21))
        is_missing[k : k + int(rng.integers(1, 21))] = True
    return replace(good, missing=is_missing, given=f"{is_missing.sum()} of {N} outputs missing")


def drift(plant: Plant, rng: np.random.Generator) -> Record:
    """The sensor's zero walks at random, by half of the output's standard deviation in all."""
    good = record(plant, rng)
    walk = np.cumsum(rng.standard_normal(N))
    walk *= 0.5 * good.y.std() / np.ptp(walk)
    return replace(good, y=good.y + walk, given=f"drift of {np.ptp(walk):.3g} in {N} samples")


def feedback(plant: Plant, rng: np.random.Generator) -> Record:
    """u = r - K y with the noisy y: the input holds the noise. K is 0.9 of what the small gain theorem allows."""
    impulse = replace(plant, chain=output_error(2, 2, 1), theta=_at_rest(output_error(2, 2, 1), _linear(plant)))
    K = 0.9 / float(np.abs(impulse.run(np.eye(1, 400)[0])).sum())
    r = _levels(N, rng)
    noise = NOISE * float(plant.run(r).std())
    e, u = noise * rng.standard_normal(N), np.zeros(N)
    for k in range(N):  # the plant's delay is a sample, so y[k] does not hold u[k]
        past = max(0, k - 400)  # what lies further back has died away
        y = plant.run(u[past : k + 1])[-1] + e[k]
        u[k] = r[k] - K * y
    return Record(u, plant.run(u) + e, noise, f"closed loop of gain {K:.2g}, {N} samples")


def coarse_sensor(plant: Plant, rng: np.random.Generator) -> Record:
    """The sensor has 12 levels over its range."""
    good = record(plant, rng)
    step = float(np.ptp(good.y)) / 12.0
    return replace(good, y=np.round(good.y / step) * step, given=f"output in steps of {step:.3g}, {N} samples")


def constant(plant: Plant, rng: np.random.Generator) -> Record:
    """The input stands still for three quarters of the record."""
    u = _levels(N, rng)
    for k in range(0, N, 250):
        u[k : k + 188] = u[k]
    return replace(record(plant, rng, u=u), given=f"input constant for 188 of every 250 samples, {N} samples")


def units(plant: Plant, rng: np.random.Generator) -> Record:
    """u and y in units from 1e-9 to 1e9 of the plant's own."""
    powers = rng.uniform(-9.0, 9.0, 2)
    scale = 10.0 ** powers[0], 10.0 ** powers[1]
    return replace(
        record(plant, rng), scale=scale, given=f"u times {scale[0]:.1e}, y times {scale[1]:.1e}, {N} samples"
    )


SPOILT: dict[str, Callable[[Plant, np.random.Generator], Record]] = {
    "constant": constant,
    "drift": drift,
    "feedback": feedback,
    "missing": missing,
    "outliers": outliers,
    "poor": poor,
    "quantised": coarse_sensor,
    "short": short,
    "units": units,
}


@dataclass(frozen=True)
class Stress:
    """Each scenario is one way to spoil a record; the seed draws the plant, the record and the damage.

    The test is a whole record of random levels with white noise alone. `Truth.noise` is that of the white noise, which
    outliers, drift and rounding come on top of.
    """

    name: str = "stress"
    about: str = "two-pole plants with spoilt estimation records, 2 % noise"

    def scenarios(self) -> Sequence[str]:
        """See `Family`."""
        return sorted(SPOILT)

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        if scenario not in SPOILT:
            raise unknown(f"scenario of {self.name}", scenario, SPOILT)
        rng = np.random.default_rng([seed, zlib.crc32(scenario.encode())])
        plant = draw_plant(rng)
        estimation, test = SPOILT[scenario](plant, rng), record(plant, rng)
        (a, c), clean = estimation.scale, plant.run(test.u)
        theta = in_units(plant, a, c)
        truth = Truth({"test": c * clean}, c * estimation.noise, plant.poles, plant.chain, theta)
        train = IOData(a * estimation.u, c * estimation.y, TS, missing=_column(estimation.missing))
        tests = {"test": IOData(a * test.u, c * test.y, TS)}
        return Task(train, tests, min(DROP, SHORT), "1", (2, 2, 1), truth, given=f"{plant.about}; {estimation.given}")


def in_units(plant: Plant, a: float, c: float) -> np.ndarray:
    """Parameters of the plant whose input is a times and whose output c times its own."""
    size = {"linear.b": c / a, "input.": a, "output.": c}
    factors = [next((v for start, v in size.items() if name.startswith(start)), 1.0) for name in plant.chain.names]
    return plant.theta * factors


def _levels(n: int, rng: np.random.Generator) -> np.ndarray:
    return Aprbs(1.0, hold_min=2 * TS, hold_max=30 * TS).generate(n, TS, rng)


def _at_rest(chain: Chain, parameters: Sequence[float]) -> np.ndarray:
    """theta (P,) with initial states of 0, from all other parameters in order."""
    theta, values = np.zeros(len(chain.names)), iter(parameters)
    starts = {f"linear.{slot.name}" for slot in chain.linear.slots() if slot.initial}
    for k, name in enumerate(chain.names):
        if name not in starts:
            theta[k] = next(values)
    return theta


def _linear(plant: Plant) -> list[float]:
    """b0, b1, f1, f2."""
    return [float(plant.theta[plant.chain.names.index(f"linear.{name}")]) for name in ("b0", "b1", "f1", "f2")]


def _column(mask: np.ndarray | None) -> np.ndarray | None:
    return None if mask is None else mask[:, None]


def _words(poles: np.ndarray) -> str:
    return " and ".join(f"{z:.3f}" if z.imag else f"{z.real:.3f}" for z in poles)
