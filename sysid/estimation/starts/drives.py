"""Starts of coupled drives: the size of the plant of the benchmark, and points around it."""

import numpy as np

from sysid.blocks import BowedGain, FrictionLag, TransferFunction
from sysid.data.record import IOData
from sysid.estimation.starts._start import Start, generators
from sysid.model.chain import Chain

SPREAD = 0.3  # of drive, belt gain and sensor offset, as a share
OWN = {  # by parameter: a lightly damped belt, a slow drive, a fast filter
    "driver.bow": 0.05,
    "drive.gain": 0.15,
    "drive.drag": 0.05,
    "drive.friction": 0.1,
    "drive.onset": 0.6,
    "drive.v0": 0.05,
    "belt.f1": -1.75,
    "belt.f2": 0.8,
    "rectifier.zero": -0.05,
    "sensor.b0": 0.5,
    "sensor.f1": -0.5,
}
BELT_GAIN = 0.05  # of all zeros of the belt together


class Drives(Start):
    """The chain that `sysid.structures.coupled_drives` makes."""

    blocks = (BowedGain, FrictionLag)

    def suits(self, chain: Chain) -> bool:
        return chain.structure == "coupled_drives"

    def starts(self, chain: Chain, data: IOData, count: int, seed: int) -> list[np.ndarray]:
        belt = next(b for b in chain.blocks if isinstance(b, TransferFunction))
        zeros = {name: BELT_GAIN / belt.nb for name in chain.names if name.startswith("belt.b")}
        values = OWN | zeros
        first = np.array([values.get(name, 0.0) for name in chain.names])
        fixed_scale = np.array([name.startswith(("belt.f", "sensor")) or name == "drive.gain" for name in chain.names])
        spread = np.where(fixed_scale, 0.0, SPREAD)
        return [first, *(first * np.exp(spread * rng.normal(size=len(first))) for rng in generators(count, seed))]
