"""The plants of `sysid.systems`: the paper's three linear models between maps of ours, and a textbook plant."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.bench.task import Task, Truth
from sysid.systems import TABLE, system

N, NOISE, DROP = 4000, 0.01, 50


@dataclass(frozen=True)
class Textbook:
    """Each plant under an aprbs, white noise of 1 % of the output's standard deviation; a second record is the test."""

    name: str = "textbook"
    about: str = "the paper's three models and a textbook plant, 4000 samples, 1 % noise"

    def scenarios(self) -> Sequence[str]:
        """The names of the plants."""
        return sorted(TABLE)

    def make(self, scenario: str, seed: int) -> Task:
        """See `Family`."""
        plant, rng = system(scenario), np.random.default_rng([seed, zlib.crc32(scenario.encode())])
        train, test = plant.record(N, NOISE, rng), plant.record(N, NOISE, rng)
        clean = {"test": plant.truth(test.u[:, 0])}
        noise = NOISE * float(plant.truth(train.u[:, 0]).std())
        linear = plant.chain.linear
        truth = Truth(clean, noise, plant.poles, plant.chain, plant.theta)
        return Task(train, {"test": test}, DROP, "1", (linear.nb, linear.nf, linear.nk), truth)
