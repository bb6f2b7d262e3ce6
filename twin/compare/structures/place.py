"""A place where the joint rubs, worn or out of line: dry friction more by size exp(-((q - place) / width)^2)."""

from collections.abc import Mapping

import numpy as np

from twin.compare.effects import Knob
from twin.compare.structures._declaration import structure
from twin.plant.added import RUB, Grid

SIZE, PLACE, WIDTH = "rub_size", "rub_place", "rub_width"


def drive(grid: Grid, values: Mapping[str, float]) -> np.ndarray:
    table = grid.zeros()
    place = grid.angle[0] + values[PLACE] * np.ptp(grid.angle)
    table[RUB] = values[SIZE] * np.exp(-(((grid.angle - place) / values[WIDTH]) ** 2))
    return table


RUBBING = structure(
    "place",
    "a place where the joint rubs",
    (
        Knob(SIZE, "V", 0.0, -3.0, 10.0, 0.2, words="friction more there"),
        Knob(PLACE, "of the stroke", 0.5, 0.0, 1.0, 0.05, words="place"),
        Knob(WIDTH, "rad", 0.1, 0.02, 0.5, 0.03, words="half of its width"),
    ),
    "--excitation staircase --set amplitude=7,hold=0.1,steps=120,order=stairs",
    "slow motion in both directions over the whole stroke",
    drive=drive,
    tries=[{PLACE: place, SIZE: size} for place in np.linspace(0.05, 0.95, 19).tolist() for size in (0.5, 1.5)],
)
