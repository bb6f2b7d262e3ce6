"""Plants drawn at random: the draw is the scenario."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.base.errors import unknown
from sysid.bench.drawing.plants import CHAINS, RECURSION, Plant, Recursion, draw_chain, draw_recursion, scale_gains
from sysid.bench.drawing.signals import INPUTS, NOISES, excitation, noise
from sysid.bench.task import Task, Truth
from sysid.data.record import IOData

LENGTHS = {"": (250, 4000), "-short": (250, 500), "-long": (10_000, 100_000)}  # samples, log-uniform
SNR = (10.0, 60.0)  # dB, uniform
DROP, TEST = 50, 2000
BEFORE = 300  # samples that the test does not show: it begins in motion, so the initial state counts


@dataclass(frozen=True)
class RandomPlants:
    """The seed draws all: orders 1 to 4, delay 0 to 4, poles, zeros, maps, input, N, Ts, noise and its size.

    The maps come from eleven families. The test is 2000 samples with the same kind of input and noise. The
    estimation record begins at rest, the test in motion.
    """

    name: str = "drawn"
    about: str = "plants drawn at random, 250 to 4000 samples (-short: to 500, -long: 10,000 to 100,000)"

    def scenarios(self) -> Sequence[str]:
        """A structure each, with its short and long versions."""
        return [kind + length for length in LENGTHS for kind in (*CHAINS, RECURSION)]

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        if scenario not in self.scenarios():
            raise unknown(f"scenario of {self.name}", scenario, self.scenarios())
        kind, dash, length = scenario.partition("-")
        rng = np.random.default_rng([seed, zlib.crc32(scenario.encode())])
        shortest, longest = LENGTHS[dash + length]
        N = round(np.exp(rng.uniform(np.log(shortest), np.log(longest))))
        Ts, input_kind = float(10 ** rng.uniform(-3, 0)), str(rng.choice(INPUTS))
        plant, u = _plant(kind, input_kind, N, rng)
        v = excitation(input_kind, BEFORE + TEST, rng)
        y, clean = plant.run(u), plant.run(v)[BEFORE:]
        noisy, snr = str(rng.choice(NOISES)), rng.uniform(*SNR)
        size = float(y.std()) * 10 ** (-snr / 20)
        train = IOData(u, y + size * noise(noisy, u, rng), Ts)
        v = v[BEFORE:]
        test = IOData(v, clean + size * noise(noisy, v, rng), Ts)
        truth = Truth({"test": clean}, size, plant.poles, plant.chain, plant.theta)
        description = f"{plant.given}; {input_kind} of {N} samples; {noisy} noise, {snr:.0f} dB"
        return Task(train, {"test": test}, DROP, "1", plant.orders, truth, given=description)


def _plant(kind: str, input_kind: str, N: int, rng: np.random.Generator) -> tuple[Plant | Recursion, np.ndarray]:
    """A plant through which the input comes, and the input (N,)."""
    u = excitation(input_kind, N, rng)
    if kind == RECURSION:
        return draw_recursion(rng), u
    while True:
        plant = scale_gains(draw_chain(kind, N, rng), u)
        if plant is not None:
            return plant, u
