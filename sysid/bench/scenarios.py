"""The cases, by name: plants x structures x starts x seeds, at one noise level and record length."""

from dataclasses import dataclass

from sysid.blocks import TransferFunction
from sysid.model.chain import Chain
from sysid.model.system import System
from sysid.structures import hammerstein_wiener
from sysid.systems import TABLE

N, NOISE = 4000, 0.01
STRUCTURES = ("own", "default")
STARTS = (1, 5)


@dataclass(frozen=True, order=True)
class Case:
    """One fit: a plant by name, 'own' structure or the 'default' Hammerstein-Wiener, number of starts, seed."""

    plant: str
    structure: str
    starts: int
    seed: int


def cases(seeds: range) -> list[Case]:
    """Every case, seeds outermost, so that a partial run covers all plants."""
    return [Case(p, s, n, seed) for seed in seeds for p in sorted(TABLE) for s in STRUCTURES for n in STARTS]


def chain(structure: str, plant: System) -> Chain:
    """The plant's own chain, or its linear orders between two maps of ten free break points."""
    linear: TransferFunction = plant.chain.linear
    return plant.chain if structure == "own" else hammerstein_wiener(linear.nb, linear.nf, linear.nk)
